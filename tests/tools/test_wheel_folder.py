"""Wheels for another computer, by the real pip on a folder of made-up wheels: no network is asked."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.tags import Tag
from packaging.utils import parse_wheel_filename

from tools.errors import ToolError
from tools.wheel_folder import CarComputer, dependencies, gather, pins

TX2 = CarComputer("aarch64", (3, 10), 27)
ORIN = CarComputer("aarch64", (3, 10), 35)
ANY = "py3-none-any"


def make_wheel(folder: Path, name: str, version: str, tag: str = ANY, needs: tuple[str, ...] = ()) -> Path:
    """The smallest wheel that pip takes."""
    path = folder / f"{name}-{version}-{tag}.whl"
    info = f"{name}-{version}.dist-info"
    requires = "".join(f"Requires-Dist: {text}\n" for text in needs)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n{requires}")
        archive.writestr(f"{info}/WHEEL", f"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: {tag}\n")
        archive.writestr(f"{info}/RECORD", "")
    return path


@pytest.fixture
def index(tmp_path, monkeypatch) -> Path:
    """What pip finds instead of a network's."""
    folder = tmp_path / "index"
    folder.mkdir()
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    monkeypatch.setenv("PIP_CONSTRAINT", str(tmp_path / "no-such-file"))
    return folder


@pytest.fixture
def car(tmp_path) -> Path:
    folder = tmp_path / "car"
    folder.mkdir()
    return folder


def names(gathered) -> dict[str, str]:
    return {name: path.name.split("-")[1] for name, path in gathered.wheels.items()}


def test_the_tags_are_those_of_a_glibc_and_all_before_it():
    assert TX2.platforms()[0] == "manylinux_2_27_aarch64"
    assert TX2.platforms()[-3:] == ["manylinux_2_17_aarch64", "manylinux2014_aarch64", "linux_aarch64"]
    assert set(TX2.platforms()) < set(ORIN.platforms())
    assert not any("_2_28_" in tag for tag in TX2.platforms())
    old = CarComputer("x86_64", (3, 12), 17).platforms()
    assert [tag for tag in old if "linux_2_" not in tag] == [
        "manylinux2014_x86_64", "manylinux2010_x86_64", "manylinux1_x86_64", "linux_x86_64"
    ]  # fmt: skip


def test_a_wheel_that_pip_is_asked_for_would_install_there():
    """Each combination of the options is a tag; that of a wheel with several tags in its name must be among them."""
    options = TX2.pip_options()
    assert options.pop(0) == "--only-binary=:all:"
    value: dict[str, list[str]] = {}
    for name, given in zip(options[::2], options[1::2], strict=True):
        value.setdefault(name, []).append(given)
    tags = {Tag("cp310", abi, platform) for abi in value["--abi"] for platform in value["--platform"]}
    wheel = "llvmlite-0.50.0-cp310-cp310-manylinux_2_27_aarch64.manylinux_2_28_aarch64.whl"
    assert parse_wheel_filename(wheel)[3] & tags
    assert not parse_wheel_filename("open3d-0.20.0-cp310-cp310-manylinux_2_35_aarch64.whl")[3] & tags
    assert value["--python-version"] == ["3.10"]


def test_pins_and_markers_are_those_of_the_cars_python_and_not_of_ours(project_root):
    lines = (project_root / "constraints.txt").read_text()
    old, new = pins(lines, TX2), pins(lines, CarComputer("x86_64", (3, 13), 40))
    assert old["numpy"] != new["numpy"]
    assert old["mcap"] == new["mcap"]
    assert old["ruamel-yaml"]
    assert TX2.heeds(Requirement("a; platform_machine == 'aarch64' and extra == 'depth'"), ["depth"])
    assert not TX2.heeds(Requirement("a; platform_machine == 'aarch64' and extra == 'depth'"))
    assert not TX2.heeds(Requirement("a; python_version >= '3.11'"))


def test_all_that_is_needed_is_gathered_by_the_other_computers_markers(index, car):
    make_wheel(index, "base", "1.0", "cp310-cp310-manylinux_2_17_aarch64")
    make_wheel(index, "base", "1.0", "cp310-cp310-manylinux_2_17_x86_64")
    make_wheel(index, "base", "2.0", "cp310-cp310-manylinux_2_17_aarch64")
    make_wheel(
        index,
        "middle",
        "1.0",
        ANY,
        ("base>=1", "old-only; python_version < '3.11'", "win; os_name == 'nt'", "late; extra == 'fast'"),
    )
    make_wheel(index, "late", "1.0")
    make_wheel(index, "old_only", "1.0")
    make_wheel(index, "speed", "1.0", "cp310-abi3-manylinux2014_aarch64", ("middle[fast]",))
    own = make_wheel(car, "own", "0.1", ANY, ("middle", "speed; extra == 'quick'", "never; extra == 'other'"))
    assert [needed.name for needed in dependencies(own, ["quick"], TX2)] == ["middle", "speed"]
    gathered = gather(own, ["quick"], {"base": "1.0", "middle": "1.0"}, TX2, car)
    assert names(gathered) == {
        "own": "0.1",
        "middle": "1.0",
        "base": "1.0",
        "old-only": "1.0",
        "speed": "1.0",
        "late": "1.0",
    }
    assert (gathered.others, gathered.missing) == ([], [])
    assert gathered.wheels["base"].name.endswith("_aarch64.whl")


def make_folder(beside: Path) -> Path:
    folder = beside.with_name("other")
    folder.mkdir()
    return folder


def test_what_the_pinned_version_has_no_wheel_for_is_told_and_replaced_where_that_is_allowed(index, car):
    make_wheel(index, "lib", "1.0", "cp310-cp310-manylinux_2_27_aarch64")
    make_wheel(index, "lib", "2.0", "cp310-cp310-manylinux_2_35_aarch64")
    make_wheel(index, "cloud", "0.18", "cp310-cp310-manylinux_2_27_aarch64")
    make_wheel(index, "cloud", "0.20", "cp310-cp310-manylinux_2_35_aarch64")
    own = make_wheel(car, "own", "0.1", ANY, ("lib>=1", "cloud>=0.20"))
    pinned = {"lib": "2.0", "cloud": "0.20"}
    gathered = gather(own, [], pinned, TX2, car)
    assert names(gathered) == {"own": "0.1", "lib": "1.0"}
    assert [other.name for other in gathered.others] == ["lib"]
    (missing,) = gathered.missing
    assert (missing.wanted.name, missing.wanted.pinned, missing.wanted.needed_by) == ("cloud", "cloud==0.20", "own")
    assert names(gather(own, [], pinned, ORIN, make_folder(car)))["cloud"] == "0.20"


def test_a_network_that_does_not_answer_is_not_a_missing_wheel(index, car, monkeypatch):
    own = make_wheel(car, "own", "0.1", ANY, ("lib",))
    monkeypatch.delenv("PIP_NO_INDEX")
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/")
    monkeypatch.setenv("PIP_EXTRA_INDEX_URL", "")
    monkeypatch.setenv("PIP_RETRIES", "0")
    with pytest.raises(ToolError, match="is there a network"):
        gather(own, [], {}, TX2, car)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--python", "310"), "--python 310: expected 3.N"),
        (("--glibc", "3.1"), "--glibc 3.1: expected 2.N"),
        (("--project", "."), "no checkout of this program"),
    ],
)
def test_the_command_refuses_what_it_cannot_do(cli, tmp_path, monkeypatch, arguments, line):
    monkeypatch.chdir(tmp_path)
    ended = cli("wheels", "car", *arguments)
    assert ended.code == 2
    assert line in ended.error_lines[0]
    assert not (tmp_path / "car").exists()


def test_the_command_tells_what_is_missing_and_how_to_install(cli, index, tmp_path, project_root, monkeypatch):
    import tools.wheel_folder

    def made_up(project, folder):
        assert project == project_root
        return make_wheel(folder, "mapfuse_robot", "0.1", ANY, ("lib", "open3d>=0.20; extra == 'depth'"))

    monkeypatch.setattr(tools.wheel_folder, "build_own_wheel", made_up)  # building asks the network for hatchling
    make_wheel(index, "lib", "1.0")
    ended = cli("wheels", tmp_path / "car", "--glibc", "2.27", "--extra", "depth", "--extra", "plots")
    assert ended.code == 3, ended.err
    lines = ended.out.splitlines()
    assert lines[0].startswith("2 wheels (0 MB) for aarch64, Python 3.10, glibc 2.27")
    assert lines[1].startswith("open3d 0.20.0: no wheel there (needed by mapfuse-robot)")
    assert "numpy projects depth images" in lines[2]
    assert lines[3].endswith(f"python3.10 -m pip install --no-index -f {tmp_path}/car 'mapfuse-robot[plots]'")
    assert cli("wheels", tmp_path / "car").code == 2  # not empty
