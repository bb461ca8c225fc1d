"""Gets the published marker tracks from their public repository, at a fixed commit, and checks every file."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pooch

from swim2real.trials.published import read_published
from swim2real.trials.reference import INDEX, save_reference
from swim2real.trials.trial import TrialSet
from swimbase.errors import TrialError

COMMIT = "08880b6ed0ac60a03fa37df9b9a85ea07746f381"
SOURCE = f"https://raw.githubusercontent.com/srl-ethz/fishsim/{COMMIT}/Data/Markers/"
PAGE = f"https://github.com/srl-ethz/fishsim/tree/{COMMIT}/Data/Markers"
SHA256 = {
    "markers_f0_50.csv": "04172540fc0f46fb2e7d0fc3367e12291bc1f47a61d92e443809ff353c61958d",
    "markers_f0_75.csv": "82021071dcf80ccc56de355803c4ea95ba44dfe44b915c7a5c7a740313a5c800",
    "markers_f1_00.csv": "616b923df8b4d15e5c6838170d83186fdb05e4f995134624a4c5bb2c37ab704e",
    "markers_f1_25.csv": "b771252ff66326a52db3cb19cd427afa3d890350146e13b14026a5585afce494",
    "markers_f1_50.csv": "8a3d4f07321cd7c401b72ea39c40ccd580b7a5082620f5db1694b6f140931c39",
    "markers_f1_75.csv": "0dedf7c1b77d9259424fbf9cbb597d603e495bca48114f5138e71325c0ca9bce",
    "markers_f2_00.csv": "9ab5961b0061009e7fe96aaae1f581cab6d7df2028219169999fd0ab63d06806",
    "markers_f2_25.csv": "850a6e09f57e4d8e76eda502e39067e13bdf79f4867801481596211c82ca0e89",
}

_ADDRESS = re.compile(r"https?://(?:[^/\s\[\]]+|\[[0-9a-fA-F:.]+\](?::\d+)?)(?:/\S*)?")
_MOST = 8_000_000  # bytes of a table; the published ones have 0.3 MB at most


def fetch(
    to: str | Path, source: str | Path | None = None, on_file: Callable[[str, str], None] = lambda n, w: None
) -> TrialSet:
    """Writes the published tracks as a reference folder.

    Args:
        to: Reference folder to write.
        source: Folder or URL that holds the CSV files; None for their public repository. Of a folder, the files that
            are there are taken; a URL must have all.
        on_file: Called with each file's name and `taken`, `downloaded` or `not there`.

    Returns:
        The trials.

    Raises:
        TrialError: No network, no file, a file that differs from the published one, or a folder in the way.
    """
    target = Path(to)
    if (target / INDEX).exists():
        raise TrialError(f"'{target}' holds a reference already; remove it or choose another folder with --to")
    address = SOURCE if source is None else str(source)
    with tempfile.TemporaryDirectory() as cache:
        online = "://" in address
        paths = _download(address, Path(cache), on_file) if online else _from_folder(Path(address), on_file)
        trials = TrialSet(tuple(read_published(path) for path in paths))
    save_reference(trials, target)
    return trials


def _from_folder(folder: Path, on_file: Callable[[str, str], None]) -> list[Path]:
    if not folder.is_dir():
        raise TrialError(f"'{folder}' is no folder; give one that holds the published CSV files")
    paths: list[Path] = []
    for name, expected in SHA256.items():
        path = folder / name
        if path.is_file():
            digest = pooch.file_hash(str(path))
            if digest != expected:
                said = f"its sha256 is {digest[:12]}…, expected {expected[:12]}…; get it again from {PAGE}"
                raise TrialError(f"{path} isn't the published file: {said}")
            paths.append(path)
        on_file(name, "taken" if path.is_file() else "not there")
    if not paths:
        raise TrialError(f"'{folder}' holds none of the published files ({', '.join(SHA256)})")
    return paths


class _Count:
    """Counts what comes, where pooch has a bar of progress, and refuses more than a table can have."""

    total = size = 0  # bytes: that the server promises, which pooch sets, and that came

    def update(self, size: int) -> None:
        self.size += size
        if self.size > _MOST:
            raise OSError(f"it has more than {_MOST / 1e6:g} MB")

    def reset(self) -> None:
        self.size = 0

    close = reset


def _download(source: str, cache: Path, on_file: Callable[[str, str], None]) -> list[Path]:
    if not _ADDRESS.fullmatch(source):
        raise TrialError(f"'{source}' is no address to download from; give one with http:// or https://, or a folder")
    pooch.get_logger().setLevel("ERROR")
    registry = {name: f"sha256:{digest}" for name, digest in SHA256.items()}
    bar: Any = _Count()  # pooch's types allow less than its documentation
    counted: Any = pooch.HTTPDownloader(progressbar=bar)
    downloads = pooch.create(path=cache, base_url=source.rstrip("/") + "/", registry=registry, retry_if_failed=2)
    paths: list[Path] = []
    for name in SHA256:
        try:
            paths.append(Path(downloads.fetch(name, downloader=counted)))
        except Exception as error:  # whatever the network library raises, which is an OSError; another hash isn't
            another = isinstance(error, ValueError) and not isinstance(error, OSError)
            what = "isn't the published file" if another else f"can't be downloaded ({type(error).__name__})"
            by_hand = f"By hand: get the files of {PAGE} and run `swim2real fetch --from FOLDER --to …`"
            raise TrialError(f"{name} from {source} {what}. {by_hand}") from error
        on_file(name, "downloaded")
    return paths
