"""The device that computes. Its kind affects the last bits of a result."""


def device_name(wanted: str) -> str:
    """The device that torch or Lightning takes for `wanted`: `cpu`, or the GPU's model.

    `wanted` is a device of torch or an accelerator of Lightning, whose `auto` depends on the
    machine. If a GPU is wanted and there is none, the name is `wanted` itself.
    """
    if wanted == "cpu":
        return wanted
    import torch  # slow to import, and not needed for the CPU

    if torch.cuda.is_available():
        return str(torch.cuda.get_device_name())
    if wanted == "auto":
        return "mps" if torch.backends.mps.is_available() else "cpu"
    return wanted
