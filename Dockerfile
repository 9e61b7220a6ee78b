# Only what finds learnt objects:  docker build --target detect -t hlp-detect .
# This one has a C compiler, which kernels need.
FROM python:3.11 AS detection_set
WORKDIR /hlp
COPY . .
RUN pip install --no-cache-dir --prefix /found -r requirements-detect.txt && \
    HLP_COMPILE=1 pip install --no-cache-dir --prefix /found --no-deps . && \
    find /found -type d -name tests -prune -exec rm -r {} +

FROM python:3.11-slim AS detect
COPY --from=detection_set /found /usr/local
WORKDIR /out
ENTRYPOINT ["hlp"]

# The demo, without anything else to install:  docker build -t hlp . && docker run --rm -v "$PWD/out:/out" hlp
FROM python:3.11-slim
WORKDIR /hlp
COPY . .
# torch comes first, from PyTorch's index of CPU builds: PyPI's brings gigabytes of CUDA packages.
RUN pip install --no-cache-dir --extra-index-url https://download.pytorch.org/whl/cpu \
        -c constraints.txt "$(grep '^torch==' constraints.txt)" && \
    pip install --no-cache-dir -c constraints.txt .
WORKDIR /out
ENTRYPOINT ["hlp"]
CMD ["run", "output=/out/demo", "work=/out/work"]
