from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapping.errors import MapFileError
from mapping.map_yaml import MapMode, MapYaml, format_map_yaml, read_map_yaml

GOOD = {
    "image": "map.pgm",
    "resolution": "0.05",
    "origin": "[1.0, -2.0, 0.5]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
NUMBERS = st.floats(-1e6, 1e6)


def written(tmp_path: Path, **changes: str | None) -> Path:
    """Write a good YAML with some lines changed, or left out where None."""
    path = tmp_path / "map.yaml"
    lines = {**GOOD, **changes}
    path.write_text("".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None), encoding="utf-8")
    return path


@given(st.floats(1e-6, 1e3), st.tuples(NUMBERS, NUMBERS, st.floats(-3.2, 3.2)), st.sampled_from(MapMode), st.booleans())
def test_every_digit_survives(
    resolution_m: float, origin: tuple[float, float, float], mode: MapMode, negate: bool
) -> None:
    with TemporaryDirectory() as folder:
        settings = MapYaml(Path(folder) / "map.pgm", mode, resolution_m, origin, negate)
        path = Path(folder) / "map.yaml"
        path.write_text(format_map_yaml(settings), encoding="utf-8")
        assert read_map_yaml(path) == settings


def test_keys_come_in_the_order_of_map_server() -> None:
    text = format_map_yaml(MapYaml(Path("runs/a.pgm"), MapMode.TRINARY, 0.0125, (-1.5, 1e-5, 0.0)))
    assert text == (
        "image: a.pgm\nmode: trinary\nresolution: 0.0125\norigin: [-1.5, 1.0e-05, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


@pytest.mark.parametrize(
    "name", ["a: b.pgm", "#1.pgm", "Küche 2.pgm", '"q".pgm', "- x.pgm", "日本.png", "~.pgm", "{a}.pgm"]
)
def test_awkward_image_names_survive(name: str, tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    settings = MapYaml(tmp_path / name, MapMode.RAW, 0.05, (0.0, 0.0, 0.0))
    path.write_text(format_map_yaml(settings), encoding="utf-8")
    assert read_map_yaml(path).image == tmp_path / name


def test_values_are_read_and_the_image_is_beside_the_yaml(tmp_path: Path) -> None:
    settings = read_map_yaml(written(tmp_path, mode="scale", negate="1", free_thresh="0.1"))
    assert settings == MapYaml(
        tmp_path / "map.pgm", MapMode.SCALE, 0.05, (1.0, -2.0, 0.5), True, occupied_thresh=0.65, free_thresh=0.1
    )


def test_paths_to_images_elsewhere_are_honoured(tmp_path: Path) -> None:
    assert read_map_yaml(written(tmp_path, image="../img/a.png")).image == tmp_path / "../img/a.png"
    assert read_map_yaml(written(tmp_path, image="/elsewhere/a.png")).image == Path("/elsewhere/a.png")


@pytest.mark.parametrize(
    ("negate", "expected"),
    [("0", False), ("1", True), ("true", True), ("False", False), ("yes", True), ("off", False), ("'no'", False)],
)
def test_negate_is_understood_as_number_and_as_word(negate: str, expected: bool, tmp_path: Path) -> None:
    assert read_map_yaml(written(tmp_path, negate=negate)).negate is expected


def test_numbers_in_the_spelling_of_yaml_1_1_are_numbers(tmp_path: Path) -> None:
    settings = read_map_yaml(written(tmp_path, resolution="'5e-2'", origin="[0, -1e1, 1.0e+0]"))
    assert (settings.resolution_m, settings.origin) == (0.05, (0.0, -10.0, 1.0))


def test_missing_optional_keys_are_named(tmp_path: Path) -> None:
    settings = read_map_yaml(written(tmp_path, negate=None, free_thresh=None))
    assert settings.missing == ("negate", "free_thresh")
    assert (settings.negate, settings.free_thresh) == (False, 0.196)
    assert read_map_yaml(written(tmp_path)).missing == ()


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("image", None, "image is None, expected the name"),
        ("image", "''", "expected the name"),
        ("image", "7", "image is 7"),
        ("resolution", None, "resolution is None"),
        ("resolution", "0", "above 0"),
        ("resolution", "-0.05", "above 0"),
        ("resolution", ".nan", "finite"),
        ("resolution", ".inf", "finite"),
        ("resolution", "fine", "resolution is 'fine'"),
        ("resolution", "true", "finite"),
        ("resolution", "1" + 400 * "0", "finite"),
        ("origin", None, "expected \\[x, y, yaw\\]"),
        ("origin", "[0, 0]", "expected \\[x, y, yaw\\]"),
        ("origin", "[0, 0, 0, 1]", "expected \\[x, y, yaw\\]"),
        ("origin", "0", "expected \\[x, y, yaw\\]"),
        ("origin", "[0, here, 0]", "origin is 'here'"),
        ("origin", "[0, .nan, 0]", "finite"),
        ("mode", "quaternary", "expected one of trinary, scale, raw"),
        ("mode", "[1]", "expected one of"),
        ("negate", "perhaps", "expected 0 or 1"),
        ("occupied_thresh", "0.1", "free < occupied"),
        ("occupied_thresh", "1.5", "free < occupied"),
        ("free_thresh", "-0.1", "free < occupied"),
        ("free_thresh", "0.65", "free < occupied"),
        ("free_thresh", "low", "free_thresh is 'low'"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(key: str, value: str | None, words: str, tmp_path: Path) -> None:
    path = written(tmp_path, **{key: value})
    with pytest.raises(MapFileError, match=words) as caught:
        read_map_yaml(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "holds nothing"),
        (b"just words", "holds str"),
        (b"- 1\n- 2\n", "holds list"),
        (b"image: [unclosed\nresolution: 1\n", "not a YAML file"),
        (b"image: a\nimage: b\n", "not a YAML file"),
        (b"P5\n2 1\n255\n\xff\xfe", "not a YAML file"),
        (b"a: 1\n---\nb: 2\n", "not a YAML file"),
    ],
)
def test_other_files_are_refused_in_one_line(content: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_bytes(content)
    with pytest.raises(MapFileError, match=words) as caught:
        read_map_yaml(path)
    assert "\n" not in str(caught.value)


def test_missing_files_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match="no such file"):
        read_map_yaml(tmp_path / "none.yaml")
    with pytest.raises(MapFileError, match="cannot read"):
        read_map_yaml(tmp_path)


def test_a_byte_order_mark_and_windows_line_ends_are_no_obstacle(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert read_map_yaml(path).resolution_m == 0.05
