"""Trained networks in detection: ONNX files run by ONNX Runtime, arrays in, arrays out."""

from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Shaped

from hlp.arrays import Features
from hlp.errors import DataError, MissingDependencyError, MissingFileError
from hlp.threads import threads_here

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

SINGLE, INTEGER = ".onnx", ".int8.onnx"
# Numbers of images vary: cuDNN's default search, for each of them, takes longer than the networks.
_CUDA = {"cudnn_conv_algo_search": "HEURISTIC"}
_PROVIDERS = {"cpu": ("CPUExecutionProvider", {}), "cuda": ("CUDAExecutionProvider", _CUDA)}


class Network:
    """A network that takes images (n, p, p, c), channels last, and gives (n, d) float32.

    On a CPU it computes with integers, so the result for one image depends neither on `threads` nor
    on the other images. Safe for use by several threads at once. A thread of a `ThreadTeam` that
    shares the processor with others computes alone.
    """

    def __init__(self, path: Path, threads: int, device: str = "cpu") -> None:
        self._path, self._threads, self._device = path, threads, device
        self._content = path.read_bytes()  # later the file may be another one
        self._sessions = {threads: self._open_session(threads)}
        self._opening = Lock()
        self.outputs = int(self._sessions[threads].get_outputs()[0].shape[1])
        """Numbers per image, d."""

    def _session_here(self) -> "InferenceSession":
        """That of one thread in a team's share: a call cannot take fewer threads than its session.

        Several threads may ask for it at once: one opens it, the others wait.
        """
        shares = self._device == "cpu" and threads_here(self._threads) != self._threads
        threads = 1 if shares else self._threads
        with self._opening:
            if threads not in self._sessions:
                self._sessions[threads] = self._open_session(threads)
            return self._sessions[threads]

    def _open_session(self, threads: int) -> "InferenceSession":
        import onnxruntime
        from onnxruntime.capi import onnxruntime_pybind11_state as kinds

        if self._device != "cpu" and hasattr(onnxruntime, "preload_dlls"):  # since 1.21
            onnxruntime.preload_dlls()  # CUDA's libraries, where pip has installed them
        provider = _PROVIDERS[self._device]
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        # Threads that spin while waiting would take processor time from those that compute.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        if not _has_vnni():
            # Without VNNI, sums of 8-bit products may overflow. The safe way takes twice as long.
            options.add_session_config_entry("session.x64quantprecision", "1")
        options.log_severity_level = 3
        damaged = kinds.InvalidProtobuf, kinds.InvalidGraph, kinds.InvalidArgument, kinds.Fail
        try:
            session = onnxruntime.InferenceSession(self._content, options, providers=[provider])
        except damaged as error:
            raise DataError(
                f"{self._path} is damaged ({error}): train again, or copy it anew"
            ) from error
        if session.get_providers()[0] != provider[0]:
            # It would go on on the CPU, which the results' fingerprint would not say.
            raise MissingDependencyError(
                f"machine.device is {self._device}, but ONNX Runtime cannot use it: its CUDA "
                "libraries do not load. Install them, or set machine.device to cpu"
            )
        return session

    def run(self, images: Shaped[np.ndarray, "n p p c"]) -> Features:
        """The network's output for each image."""
        if len(images) == 0:
            return np.zeros((0, self.outputs), dtype=np.float32)
        return np.asarray(self._session_here().run(None, {"images": images})[0])


def _has_vnni(flags_file: Path = Path("/proc/cpuinfo")) -> bool:
    """Whether the processor is known to add products of 8-bit integers in 32 bits."""
    try:
        flags = set(flags_file.read_text().split())
    except OSError:
        return False
    return not flags.isdisjoint({"avx512_vnni", "avx_vnni"})


def require_device(device: str) -> None:
    """Raise MissingDependencyError if the installed ONNX Runtime does not support the device."""
    import onnxruntime

    if _PROVIDERS[device][0] not in onnxruntime.get_available_providers():
        raise MissingDependencyError(
            f"machine.device is {device}: the installed ONNX Runtime does not support it. "
            "Install onnxruntime-gpu in place of onnxruntime, or set machine.device to cpu"
        )


def load_network(stem: Path, threads: int, device: str = "cpu") -> Network:
    """The network that `export_network` wrote: 8-bit integers on a CPU, single precision on a GPU.

    Raises MissingFileError if there is none, MissingDependencyError if the installed ONNX Runtime
    does not support the device.
    """
    require_device(device)
    path = stem.with_name(stem.name + (INTEGER if device == "cpu" else SINGLE))
    if not path.is_file():
        raise MissingFileError(f"{path.parent} holds no trained network: it has no {path.name}")
    return Network(path, threads, device)
