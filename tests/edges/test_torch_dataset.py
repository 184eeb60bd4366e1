"""Example that reads a data set for PyTorch, with and without PyTorch installed."""

import importlib.util
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

import data_set_study
import dechirp as dc
from dechirp.results.data_set import open_data_set_groups

FILE = Path(dc.__file__).parents[2] / "examples" / "torch_dataset.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("torch_dataset", FILE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["torch_dataset"] = module  # workers import its classes by this name
    spec.loader.exec_module(module)
    yield module
    del sys.modules["torch_dataset"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("data")
    data_set_study.run_to_folder(out, data_set_study.make_adaptive_study())
    return out / "data.zarr"


def test_items_equal_stored_trials(example, folder):
    data = open_data_set_groups(folder)
    items = example.Items(folder)
    assert len(items) == int(data[""].made.sum()) < data[""].made.size
    for index in (0, len(items) - 1):
        point, trial = items.positions[index]
        item, labels = items[index]
        assert item.dtype == np.float32
        np.testing.assert_allclose(item, data[""].power[point, trial], atol=1e-4)
        np.testing.assert_allclose(labels["range"], data["truth"].range[point, trial], rtol=1e-6)
    assert items.classes == ["point", "point"]


def test_labels_lie_on_peaks_of_map(example, folder):
    """The van is 25 dB over the noise, so its peak is in the nearest cell or next to it."""
    items = example.Items(folder)
    for index in range(len(items)):
        level_dbw, labels = items[index]
        row, column = (round(float(labels[name][0, 1])) for name in ("row", "column"))
        patch = level_dbw[0, row - 3 : row + 4, column - 3 : column + 4]
        peak = np.array(np.unravel_index(patch.argmax(), patch.shape))
        assert abs(peak - 3).max() <= 1


def test_cube_items_are_complex_samples_of_data_set(example, folder):
    data = open_data_set_groups(folder)[""]
    cube, labels = example.Items(folder, content="cube")[2]
    scale = np.float32(data.cube_scale[0, 2])
    np.testing.assert_array_equal(cube.imag, data.cube[0, 2, ..., 1] * scale)
    assert "row" not in labels


def test_splits_by_trials_are_disjoint(example, folder):
    parts = [example.Items(folder, trials=limits) for limits in ((0, 0.5), (0.5, 1))]
    trial_sets = [set(part.positions[:, 1].tolist()) for part in parts]
    assert not trial_sets[0] & trial_sets[1]
    assert sum(map(len, parts)) == len(example.Items(folder))


def test_items_can_be_pickled(example, folder):
    items = example.Items(folder)
    copy = pickle.loads(pickle.dumps(items))
    np.testing.assert_array_equal(copy[3][0], items[3][0])


def test_example_prints_first_item(example, folder, capsys):
    example.main(str(folder))
    output = capsys.readouterr().out
    assert "items of power (1, 32, 64)" in output
    assert "van (point): row" in output


def test_rejects_folder_without_data_set_with_message(example, folder, tmp_path, capsys):
    for path in (tmp_path, tmp_path / "nothing", folder / "truth"):
        with pytest.raises(SystemExit) as exit_info:
            example.main(str(path))
        assert exit_info.value.code == 2
        assert capsys.readouterr().err.startswith(f"{path}: no data set with maps")


@pytest.mark.parametrize("n_workers", [0, 2])
def test_data_loader_gives_same_items(example, folder, n_workers):
    torch = pytest.importorskip("torch")
    items = example.Items(folder)
    loader = torch.utils.data.DataLoader(
        example.TorchItems(items), batch_size=4, num_workers=n_workers
    )
    level_dbw, labels = next(iter(loader))
    assert level_dbw.dtype == torch.float32
    for index in range(4):
        np.testing.assert_array_equal(level_dbw[index].numpy(), items[index][0])
        np.testing.assert_array_equal(labels["range"][index].numpy(), items[index][1]["range"])
