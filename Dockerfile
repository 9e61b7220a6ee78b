# The demo, without anything else to install:  docker build -t hlp . && docker run --rm -v "$PWD/out:/out" hlp
FROM python:3.11-slim
WORKDIR /hlp
COPY . .
# torch comes first: named by a dependant, pip would take it with gigabytes of CUDA packages.
RUN pip install --no-cache-dir -c constraints.txt "$(grep '^torch==' constraints.txt)" && \
    pip install --no-cache-dir -c constraints.txt .
WORKDIR /out
ENTRYPOINT ["hlp"]
CMD ["run", "output=/out/demo", "work=/out/work"]
