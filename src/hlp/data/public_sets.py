"""Public data sets that `hlp download` loads: archives, sources, licences.

Archives are those of BOP's hub (huggingface.co/datasets/bop-benchmark) and of PASCAL VOC's server.
A licence or a checksum is stated only where it is known; `None` is not known. The server is asked
for sizes.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from hlp.errors import InputError

BOP_HUB = "https://huggingface.co/datasets/bop-benchmark"
VOC_SERVER = "http://host.robots.ox.ac.uk/pascal/VOC/voc2012"
IMAGES = ("bop19", "all")
"""Which test images: those of BOP's challenges, or all."""
KNOWN = {
    "lmo_test_bop19.zip": "sha256:42d7a15f317476ca3980ee7ec0344b691cbadc796835f0b14f72c89a1dcec421",
    "tless_test_primesense_bop19.zip": (
        "sha256:1a18f6bbfb5ac4ced8529f7a35225adfed88c0f62ef38067933e2b541ef1d00b"
    ),
    "tudl_test_bop19.zip": (
        "sha256:cc68c55004dc7822a10910033aedffb3d40bf5bb0a39497b13e566dedddbea14"
    ),
    "VOCtrainval_11-May-2012.tar": "md5:6cd6e144f989b92b3379bac3b3de84fd",
}
"""Checksums of images, where they are known. Lists of targets and models may get new versions."""


@dataclass(frozen=True)
class Archive:
    """One file of a data set: its address and, where known, `sha256:HEX` or `md5:HEX`."""

    url: str
    checksum: str | None = None

    @property
    def name(self) -> str:
        """The file's name."""
        return self.url.rpartition("/")[2]


@dataclass(frozen=True)
class PublicSet:
    """A public data set: what it is, where it comes from, which archives it consists of.

    `archives` are by `images`, each path below `base`. `next_step` is shown when all is there, with
    {folder} for the folder.
    """

    name: str
    what: str
    base: str
    page: str
    licence: str | None
    archives: Mapping[str, tuple[str, ...]]
    next_step: str

    def files(self, images: str, mirror: str | None = None) -> tuple[Archive, ...]:
        """The archives to load; `mirror` is an address in place of `base`.

        Raises InputError where the set has no such images.
        """
        if images not in self.archives:
            raise InputError(f"images={images}: {self.name} has {', '.join(self.archives)}")
        urls = [f"{(mirror or self.base).rstrip('/')}/{path}" for path in self.archives[images]]
        return tuple(Archive(url, KNOWN.get(Archive(url).name)) for url in urls)


def find_set(name: str) -> PublicSet:
    """The data set of a name. Raises InputError naming all of them."""
    if name not in SETS:
        raise InputError(f"there is no data set '{name}': choose from {', '.join(SETS)}")
    return SETS[name]


def _bop(name: str, what: str, licence: str | None, test: str = "test") -> PublicSet:
    archives = {
        images: tuple(
            f"{name}/resolve/main/{name}_{part}.zip"
            for part in ("base", "models", f"{test}_{images}")
        )
        for images in IMAGES
    }
    page = f"https://bop.felk.cvut.cz/datasets/#{what.partition(':')[0]}"
    step = "hlp run data=bop data.root={folder} data.split=test"  # some true poses are private
    return PublicSet(name, what, BOP_HUB, page, licence, archives, step)


_ALL = (
    _bop("lmo", "LM-O: 8 of LINEMOD's objects, occluded", "CC BY-SA 4.0"),
    _bop("tless", "T-LESS: 30 parts without texture", "CC BY 4.0", "test_primesense"),
    _bop("tudl", "TUD-L: 3 objects in changing light", "CC BY-SA 4.0"),
    _bop("icbin", "IC-BIN: 2 objects, many of each in a bin", None),
    _bop("itodd", "ITODD: 28 industrial parts, grey images", "CC BY-NC-SA 4.0"),
    _bop("hb", "HB: 33 household and industrial objects", "CC0 1.0", "test_primesense"),
    _bop("ycbv", "YCB-V: 21 textured household objects, occluded", "MIT"),
    _bop("lm", "LM: LINEMOD, 15 objects on a cluttered table", None),
    PublicSet(
        "voc2012",
        "PASCAL VOC 2012: photographs, backgrounds of training in the paper",
        VOC_SERVER,
        "http://host.robots.ox.ac.uk/pascal/VOC/voc2012/",
        "none of its own: flickr's terms of use",
        {"all": ("VOCtrainval_11-May-2012.tar",)},
        "hlp run data=bop data.root=… data.photographs={folder}/VOCdevkit/VOC2012/JPEGImages",
    ),
)
SETS = {public.name: public for public in _ALL}
"""All data sets by name: BOP's seven core sets first."""
