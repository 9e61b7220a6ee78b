"""Size and kind of images, from the beginning of their files."""

from pathlib import Path

from hlp.errors import DataError, MissingFileError

_DEPTH_MODES = ("I;16", "I;16B", "I;16L", "I", "F")


def image_size(path: Path, most_megapixels: float) -> tuple[int, int]:
    """Width and height of a colour or grey image.

    Raises MissingFileError; DataError for a file that is no image, empty or larger than
    `most_megapixels`.
    """
    return _header(path, most_megapixels)[0]


def depth_image_size(path: Path, most_megapixels: float) -> tuple[int, int]:
    """The same for a depth image. Raises DataError if it does not have one channel of 16 bits."""
    size, mode = _header(path, most_megapixels)
    if mode not in _DEPTH_MODES:
        raise DataError(
            f"{path} has pixels of the kind {mode}: depth must be a 16-bit PNG of one channel"
        )
    return size


def require_same_size(rgb_path: Path, size: tuple[int, int], depth_size: tuple[int, int]) -> None:
    """Raise DataError unless colour and depth of a frame have the same size (width, height)."""
    if size != depth_size:
        raise DataError(
            f"{rgb_path} is {size[0]}x{size[1]} but its depth image is "
            f"{depth_size[0]}x{depth_size[1]}: register depth to colour first"
        )


def _header(path: Path, most_megapixels: float) -> tuple[tuple[int, int], str]:
    from PIL import Image, UnidentifiedImageError

    if not path.is_file():
        raise MissingFileError(f"no image {path}")
    try:
        with Image.open(path) as image:
            size, mode = (int(image.size[0]), int(image.size[1])), str(image.mode)
    except PermissionError as error:
        raise DataError(f"{path} may not be read: give yourself the right to") from error
    except Image.DecompressionBombError as error:
        raise _too_large(path, most_megapixels) from error
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise DataError(f"{path} is truncated or no image: copy or download it again") from error
    if size[0] * size[1] > most_megapixels * 1e6:
        raise _too_large(path, most_megapixels, size)
    return size, mode


def _too_large(path: Path, most: float, size: tuple[int, int] | None = None) -> DataError:
    stated = "" if size is None else f" of {size[0]}x{size[1]}"
    return DataError(
        f"{path} is an image{stated} with more than {most:g} megapixels: make it smaller, or raise "
        "data.max_megapixels"
    )
