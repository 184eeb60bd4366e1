"""A data set of `dechirp study` for PyTorch: maps or samples, and their labels.

    dechirp study examples/studies/data-set.yaml
    python examples/torch_dataset.py dechirp-study/data.zarr

`Items` needs zarr and NumPy alone; `TorchItems` returns tensors instead of arrays and supports
any number of workers of a `DataLoader`.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import zarr

try:
    import torch
    from torch.utils.data import Dataset
except ImportError:  # Items needs no PyTorch
    torch = None
    Dataset = object


class Items:
    """Finished items of the data set as arrays.

    Parameters
    ----------
    path : Path
        The folder `data.zarr`.
    content : str
        `power`: maps in dBW, float32 (frame, velocity, range). `cube`: samples in sqrt(W),
        complex64, or float32 of real sampling, (frame, chirp, rx, sample).
    trials : tuple of float
        Start and end of the selected fraction of trials: (0, 0.8) to train, (0.8, 1) to test.
        Trial t has the same noise at every point, so split by trials, not by points.
    """

    def __init__(
        self, path: Path, content: str = "power", trials: tuple[float, float] = (0.0, 1.0)
    ) -> None:
        self.path, self.content = Path(path), content
        self._group: zarr.Group | None = None
        is_finished = self.group["made"][:]
        _ = self.group[content]  # raises KeyError here instead of in a worker
        ends = np.round(np.array(trials) * is_finished.shape[1]).astype(int)
        positions = np.argwhere(is_finished)
        self.positions = positions[(positions[:, 1] >= ends[0]) & (positions[:, 1] < ends[1])]
        self.names = [str(name) for name in self.group["truth/target"][:]]
        self.classes = [str(name) for name in self.group["truth/class"][:]]

    @property
    def group(self) -> zarr.Group:
        """The data set; each process opens its own."""
        if self._group is None:
            self._group = zarr.open_group(self.path, mode="r")
        return self._group

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_group": None}

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, index: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the item and its labels, each (frame, target).

        `range` (m), `velocity` (m/s), `azimuth` (rad) and `snr` (ratio); for maps also `row` and
        `column`: position of each target on the map, in cells.
        """
        point, trial = (int(number) for number in self.positions[index])
        truth = {
            name: self.group[f"truth/{name}"][point, trial].astype(np.float32)
            for name in ("range", "velocity", "azimuth", "snr")
        }
        numbers = self.group[self.content][point, trial]
        if self.content == "power":
            step_db = self.group["power"].attrs["scale_factor"]
            return numbers * np.float32(step_db), {**truth, **self._cells(point, trial)}
        samples = numbers * np.float32(self.group["cube_scale"][point, trial])
        if self.group["cube"].metadata.dimension_names[-1] == "iq":
            samples = samples.view(np.complex64)[..., 0]
        return samples, truth

    def _cells(self, point: int, trial: int) -> dict[str, np.ndarray]:
        ranges, velocities = (self.group[f"{name}_bins"][point] for name in ("range", "velocity"))
        truth = {
            name: self.group[f"truth/map_{name}"][point, trial] for name in ("range", "velocity")
        }
        rows = [
            np.interp(velocity, bins, np.arange(len(bins)))
            for velocity, bins in zip(truth["velocity"], velocities, strict=True)
        ]
        columns = np.interp(truth["range"], ranges, np.arange(len(ranges)))
        return {"row": np.array(rows, np.float32), "column": columns.astype(np.float32)}


class TorchItems(Dataset):
    """Items as tensors, for `torch.utils.data.DataLoader`."""

    def __init__(self, items: Items) -> None:
        self.items = items

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, index: int) -> tuple[Any, dict[str, Any]]:
        item, labels = self.items[index]
        return torch.from_numpy(item), {
            name: torch.from_numpy(values) for name, values in labels.items()
        }


def main(path: str = "dechirp-study/data.zarr") -> None:
    """Print the first item; with PyTorch, load all items in batches."""
    try:
        items = Items(Path(path))
    except (OSError, KeyError):
        print(f"{path}: no data set with maps that `dechirp study` has finished.", file=sys.stderr)
        sys.exit(2)
    item, labels = items[0]
    print(f"{len(items)} items of {items.content} {item.shape}")
    for target, name in enumerate(items.names):
        row, column = (float(labels[key][0, target]) for key in ("row", "column"))
        print(f"{name} ({items.classes[target]}): row {row:.1f}, column {column:.1f}")
    if torch is None:
        print("PyTorch is not installed: no batches.")
        return
    loader = torch.utils.data.DataLoader(TorchItems(items), batch_size=32, shuffle=True)
    n_batches = sum(1 for _ in loader)
    print(f"{n_batches} batches")


if __name__ == "__main__":
    main(*sys.argv[1:2])
