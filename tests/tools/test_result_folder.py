"""Which earlier results a command replaces, and what it never touches."""

from __future__ import annotations

import pytest

from tools.errors import ToolError
from tools.result_folder import FUSED, MAPPED, check_result_folder, new_results, new_set_folder


def filled(folder, *names):
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).write_text("years of work")
    return folder


def names_in(folder):
    return {file.name for file in folder.iterdir()}


def test_results_of_an_earlier_run_are_replaced_as_a_whole_and_told(tmp_path, caplog):
    caplog.set_level("INFO")
    old = ("map.yaml", "depth_map.png", "both_map.npz", "slam_state.npz", "trajectory_in_map.tum", "report.json")
    folder = filled(tmp_path / "out", *old, "notes.txt", "plan.json")
    check_result_folder(folder, MAPPED)
    assert new_results(folder, MAPPED) == folder
    assert names_in(folder) == {"notes.txt", "plan.json"}
    assert "replaces" in caplog.text


def test_new_folders_are_made_and_nothing_is_told(tmp_path, caplog):
    caplog.set_level("INFO")
    check_result_folder(tmp_path / "new/one", MAPPED)
    assert not (tmp_path / "new").exists()
    assert new_results(tmp_path / "new/one", MAPPED).is_dir()
    assert not caplog.text


@pytest.mark.parametrize(
    ("there", "products", "reason"),
    [
        (("recording.mcap", "map.yaml", "report.json"), MAPPED, "came of that drive"),
        (("global_0.yaml", "report.json"), MAPPED, "not of this command"),
        (("map.yaml", "report.json"), FUSED, "not of this command"),
    ],
)
def test_what_cannot_be_made_again_or_is_another_command_s_is_refused(tmp_path, there, products, reason):
    folder = filled(tmp_path / "out", *there)
    with pytest.raises(ToolError, match=reason):
        check_result_folder(folder, products)
    assert names_in(folder) == set(there)


def test_what_is_read_is_not_replaced(tmp_path):
    folder = filled(tmp_path / "out", "map.yaml", "global_0.npz", "notes.txt")
    for bad, products in ((folder / "map.yaml", MAPPED), (folder, MAPPED), (folder / "global_0.npz", FUSED)):
        with pytest.raises(ToolError, match="is read"):
            check_result_folder(folder, products, [bad])
    check_result_folder(folder, MAPPED, [folder / "notes.txt", tmp_path / "map.yaml"])


def test_a_folder_of_a_recording_alone_takes_its_replay(tmp_path):
    folder = filled(tmp_path / "out", "recording.mcap")
    check_result_folder(folder, MAPPED)
    with pytest.raises(ToolError, match=r"holds recording\.mcap: name"):
        check_result_folder(folder, MAPPED, records=True)


def test_a_folder_takes_its_name_when_it_is_done(tmp_path):
    with pytest.raises(OSError, match="no-folder"), new_set_folder(tmp_path / "x") as folder:
        (folder / "no-folder/a").write_text("a")
    assert list(tmp_path.iterdir()) == []
    with new_set_folder(tmp_path / "x") as folder:
        (folder / "maps/a").write_text("a")
        assert not (tmp_path / "x").exists()
    assert (tmp_path / "x/maps/a").read_text() == "a"
    with pytest.raises(ToolError, match="is there already"), new_set_folder(tmp_path / "x"):
        pass
