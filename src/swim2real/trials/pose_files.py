"""Pose files in HDF5: analyses of SLEAP (.h5) and data sets of movement (.nc). Pixels, y down, a row per frame."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swimbase.arrays import Array
from swimbase.errors import MissingExtraError, TrialError
from swimbase.store import MOST_ARRAYS, whole_file

SLEAP, MOVEMENT = (".h5", ".hdf5"), (".nc",)
_DIMS = ("track", "xy", "node", "frame")  # in which SLEAP writes its axes where the file doesn't say
_ANIMAL = "swimmer"
_WANTED = "an analysis of SLEAP (.h5) or a data set of movement (.nc) is wanted; DeepLabCut's tables as .csv"


def read_file(path: Path) -> tuple[Array, dict[str, dict[str, Array]]]:
    """Reads a pose file.

    Returns:
        Numbers of the frames, counted from the film's first, 0, of shape (T,); and by animal and marker the cells x, y
        and likelihood of shape (T, 3), a likelihood infinite where the file has none.

    Raises:
        TrialError: The file isn't there or is another one.
        MissingExtraError: The library that reads it isn't installed.
    """
    try:
        frames, names, markers, cells = _read_sleap(path) if path.suffix.lower() in SLEAP else _read_movement(path)
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    except (OSError, LookupError, ValueError, TypeError, AttributeError) as error:
        raise TrialError(f"{path}: not readable ({error}); {_WANTED}") from error
    seen = {name: dict(zip(markers, of, strict=True)) for name, of in zip(names, cells, strict=True)}
    return frames, seen


def write_file(
    path: Path, frames: Sequence[int], positions: Array, confidence: Array, names: Sequence[str], fps: float
) -> None:
    """Writes a pose file of one animal, whole or not at all, in the format of its ending.

    Args:
        path: Path of the file: .h5 of SLEAP, .nc of movement.
        frames: Numbers of the frames, counted from the film's first, 0. Shape (T,).
        positions: Positions, NaN where unknown [px]. Shape (T, M, 2).
        confidence: Likelihoods. Shape (T, M).
        names: Names of the markers.
        fps: Frames per second of the film.

    Raises:
        TrialError: The file can't be written.
        MissingExtraError: The library that writes it isn't installed.
    """
    write = _write_sleap if path.suffix.lower() in SLEAP else _write_movement
    try:
        with whole_file(path) as part:
            write(part, np.asarray(frames, np.intp), positions, confidence, list(names), fps)
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    except OSError as error:
        raise TrialError(f"can't write '{path}': {error.strerror or error}") from error


def _missing(error: ModuleNotFoundError) -> MissingExtraError:
    return MissingExtraError(f"pose files need {error.name}; install it with: pip install 'swim2real[poses]'")


_Read = tuple[Array, list[str], list[str], Array]  # frames, animals, markers, and cells (animals, M, T, 3)


def _read_sleap(path: Path) -> _Read:
    import h5py

    with h5py.File(path) as file:
        sets: Mapping[str, Any] = {str(key): one for key, one in file.items() if isinstance(one, h5py.Dataset)}
        _check_size(sum(one.nbytes for one in sets.values()))
        content = {key: one[()] for key, one in sets.items()}
        dims = {key: json.loads(one.attrs["dims"]) for key, one in sets.items() if "dims" in one.attrs}
    tracks = _ordered(content["tracks"], dims.get("tracks", _DIMS), _DIMS)
    scores = content.get("point_scores")
    if scores is not None:
        scores = _ordered(scores, dims.get("point_scores", ("track", "node", "frame")), ("track", "node", "frame"))
    cells = np.full((tracks.shape[0], tracks.shape[2], tracks.shape[3], 3), np.inf)
    cells[..., :2] = tracks.transpose(0, 2, 3, 1)
    if scores is not None:
        cells[..., 2] = scores
    there = np.isfinite(tracks).any(axis=(0, 1, 2))
    if "track_occupancy" in content:
        order = dims.get("track_occupancy", ("frame", "track"))
        there |= _ordered(content["track_occupancy"], order, ("track", "frame")).any(axis=0)
    names = _texts(content.get("track_names", ())) or [_ANIMAL]
    return np.flatnonzero(there).astype(float), names, _texts(content["node_names"]), cells[:, :, there]


def _check_size(size: int) -> None:
    """Refuses more bytes than are read, before any is unpacked."""
    if size > MOST_ARRAYS:
        raise ValueError(f"its arrays have {size / 1e6:.0f} MB; at most {MOST_ARRAYS / 1e6:.0f} MB are read")


def _ordered(values: Array, dims: Sequence[str], wanted: Sequence[str]) -> Array:
    """An array with its axes in the wanted order."""
    return np.transpose(np.asarray(values, float), [list(dims).index(one) for one in wanted])


def _texts(values: Any) -> list[str]:
    return [one.decode() if isinstance(one, bytes) else str(one) for one in values]


def _write_sleap(
    path: Path, frames: NDArray[np.intp], positions: Array, confidence: Array, names: list[str], fps: float
) -> None:
    """Writes an analysis of all frames from the film's first; those that aren't in the track are occupied by none."""
    import h5py

    del fps  # SLEAP's file has none
    count, markers = int(frames[-1]) + 1, len(names)
    tracks, scores = np.full((1, 2, markers, count), np.nan), np.full((1, markers, count), np.nan)
    tracks[0][..., frames], scores[0][..., frames] = positions.transpose(2, 1, 0), confidence.T
    occupied, unknown = np.zeros((count, 1), np.uint8), np.full((1, count), np.nan)
    occupied[frames] = 1
    with h5py.File(path, "w") as file:
        for key, values, dims in (
            ("tracks", tracks, _DIMS), ("point_scores", scores, ("track", "node", "frame")),
            ("track_occupancy", occupied, ("frame", "track")), ("instance_scores", unknown, ("track", "frame")),
            ("tracking_scores", unknown, ("track", "frame")),
        ):  # fmt: skip
            file.create_dataset(key, data=values, compression="gzip").attrs["dims"] = json.dumps(dims)
        for key, texts in (("track_names", [_ANIMAL]), ("node_names", names)):
            file.create_dataset(key, data=[text.encode() for text in texts])
        for key, nothing in (("edge_names", np.zeros((0, 2), "S1")), ("edge_inds", np.zeros((0, 2), int))):
            file.create_dataset(key, data=nothing)
        for key, text in (("labels_path", ""), ("video_path", ""), ("provenance", "{}")):
            file.create_dataset(key, data=text)
        file.create_dataset("video_ind", data=0)


def _read_movement(path: Path) -> _Read:
    import xarray as xr

    with xr.open_dataset(path) as data:
        _check_size(data.nbytes)
        time = np.asarray(data["time"].values, float)
        frames = np.rint(time * float(data.attrs["fps"])) if data.attrs.get("time_unit") == "seconds" else time
        position = data["position"].sel(space=["x", "y"]).transpose("individuals", "keypoints", "time", "space")
        cells = np.full((*position.shape[:3], 3), np.inf)
        cells[..., :2] = position.values
        if "confidence" in data:
            cells[..., 2] = data["confidence"].transpose("individuals", "keypoints", "time").values
        names, markers = (_texts(data[key].values) for key in ("individuals", "keypoints"))
    return frames, names, markers, cells


def _write_movement(
    path: Path, frames: NDArray[np.intp], positions: Array, confidence: Array, names: list[str], fps: float
) -> None:
    import xarray as xr

    data = xr.Dataset(
        {
            "position": (("time", "space", "keypoints", "individuals"), positions.transpose(0, 2, 1)[..., None]),
            "confidence": (("time", "keypoints", "individuals"), confidence[..., None]),
        },
        {"time": frames / fps, "space": ["x", "y"], "keypoints": names, "individuals": [_ANIMAL]},
        {"ds_type": "poses", "fps": fps, "time_unit": "seconds", "source_software": "swim2real"},
    )
    data.to_netcdf(path, engine="h5netcdf")
