from __future__ import annotations

import numpy as np
import pytest

from tools.alignment_view import AlignmentView, chance_text, figures, headline, percent, pose_text

POSE = np.array([1.25, -2.0, np.pi / 2.0])


def test_figures_tell_pose_and_sigma_in_metres_and_degrees():
    covariance = np.diag([0.01**2, 0.02**2, np.radians(0.5) ** 2])
    view = AlignmentView("accepted", "", POSE, covariance=covariance, common_wall_m=12.34, conflict_m=0.0)
    rows = dict(figures(view, POSE))
    assert rows["B in A: x"] == "1.250 +- 0.010 m"
    assert rows["B in A: y"] == "-2.000 +- 0.020 m"
    assert rows["B in A: turn"] == "90.000 +- 0.500 deg"
    assert rows["wall seen by both"] == "12.3 m"
    assert rows["wall in the other's free space"] == "0.0 m"


def test_what_is_not_known_is_not_told():
    names = [name for name, _ in figures(AlignmentView("refused", "", POSE), POSE)]
    assert not {"wall seen by both", "wall in the other's free space", "matching features"} & set(names)
    assert all(name.startswith("best guess") for name in names[:3])
    assert chance_text(AlignmentView("refused", "", POSE)) == ""


def test_only_an_accepted_pose_is_told_as_the_answer():
    assert pose_text(POSE) in headline(AlignmentView("accepted", "", POSE))
    for view in (
        AlignmentView("refused", "", POSE),
        AlignmentView("ambiguous", "", POSE, alternatives=((POSE, 0.4),)),
        AlignmentView("refused", ""),
    ):
        assert headline(view).startswith("Not merged")
        assert pose_text(POSE) not in headline(view)


def test_an_ambiguous_verdict_tells_both_probabilities():
    view = AlignmentView("ambiguous", "", POSE, probability=0.48, alternatives=((POSE, 0.45), (POSE, 0.05)))
    assert chance_text(view) == "48 % or 45 %"


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.0, "0 %"), (0.004, "< 1 %"), (0.01, "1 %"), (0.5, "50 %"), (0.99, "99 %"), (0.9951, "> 99 %"), (1.0, "100 %")],
)
def test_percent_never_rounds_to_all_or_nothing(share, text):
    assert percent(share) == text


def test_a_view_that_makes_no_sense_is_refused():
    with pytest.raises(ValueError, match="verdict 'maybe', expected one of accepted, refused, ambiguous"):
        AlignmentView("maybe", "")
    with pytest.raises(ValueError, match="not a finite"):
        AlignmentView("accepted", "", np.array([0.0, np.nan, 0.0]))
    with pytest.raises(ValueError, match="not a finite"):
        AlignmentView("refused", "", alternatives=((np.zeros(2), 0.1),))
    with pytest.raises(ValueError, match="give both or none"):
        AlignmentView("refused", "", score=np.zeros((2, 2)))
    with pytest.raises(ValueError, match="are no pairs"):
        AlignmentView("refused", "", points_a=np.zeros((3, 2)), points_b=np.zeros((2, 2)))
