from __future__ import annotations

import numpy as np
import pytest

from tools.lettering import fitted, text_width_px, to_ascii, wrapped, write_text

REASON = "12 % of the walls stand where the other map saw free space, and only 4.1 m of wall are seen in both maps"


@pytest.mark.parametrize("width_px", [200, 333, 700, 5000])
def test_wrapped_lines_fit_and_hold_every_word_in_order(width_px):
    lines = wrapped(REASON, width_px, 0.6, most_lines=50)
    assert " ".join(lines) == REASON
    assert max(text_width_px(line, 0.6) for line in lines) <= width_px


def test_what_exceeds_the_lines_is_cut_with_dots():
    lines = wrapped(REASON, 250, 0.6, most_lines=2)
    assert len(lines) == 2
    assert lines[-1].endswith("...")
    assert max(text_width_px(line, 0.6) for line in lines) <= 250


def test_a_word_wider_than_the_room_is_cut():
    assert text_width_px(wrapped("m" * 300 + " end", 200, 0.5, most_lines=3)[0], 0.5) <= 200


def test_nothing_to_say_needs_no_line():
    assert wrapped("", 200, 0.5, most_lines=3) == []


@pytest.mark.parametrize("bold", [False, True])
def test_fitted_keeps_what_fits_and_shortens_the_rest(bold):
    assert fitted("short", 500, 0.5, bold=bold) == "short"
    cut = fitted(REASON, 300, 0.5, bold=bold)
    assert cut.endswith("...")
    assert REASON.startswith(cut[:-3])
    assert text_width_px(cut, 0.5, bold=bold) <= 300
    assert fitted(REASON, 0, 0.5, bold=bold) == "..."


def test_text_becomes_ascii_on_one_line():
    assert to_ascii("ω ≥ 0.95,\nturned by 3° ± 1°") == "omega >= 0.95, turned by 3 deg +- 1 deg"
    assert to_ascii("Büro") == "B?ro"


def test_text_is_drawn_over_its_base_line_and_a_halo_is_wider():
    plain, halo = (np.full((60, 200, 3), 128, np.uint8) for _ in range(2))
    write_text(plain, "map A", (20, 40), 0.6, (0, 0, 0))
    write_text(halo, "map A", (20, 40), 0.6, (0, 0, 0), halo=True)
    changed = (plain != 128).any(axis=2)
    rows, cols = np.nonzero(changed)
    assert rows.max() <= 46
    assert cols.min() >= 18
    assert (halo != 128).any(axis=2).sum() > 1.5 * changed.sum()
