"""The structure of many maps, against poses that are known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fusion.alignment import inverse_jacobian
from fusion.map_graph import MapEdge, Structure, carried_covariance, connect
from mapping import se2

FLOOR = np.array([0.01, 0.01, 0.002]) ** 2  # of the rule
COVARIANCE = np.diag([0.01, 0.01, 0.002]) ** 2


def places(count: int) -> dict[str, np.ndarray]:
    """True poses of maps m0, m1 ..., in a world that no map knows."""
    random = np.random.default_rng(4)
    return {
        f"m{number}": np.array([*random.uniform(-20.0, 20.0, 2), random.uniform(-3.0, 3.0)]) for number in range(count)
    }


def middles(names) -> dict[str, np.ndarray]:
    return {name: np.array([30.0, -12.0 + number]) for number, name in enumerate(names)}


def edge(truth, a: str, b: str, probability: float = 0.99, off=(0.0, 0.0, 0.0)) -> MapEdge:
    """An alignment that is off by a pose at the middle of map b, where the covariance holds too."""
    middle = np.append(middles(truth)[b], 0.0)
    at_middle = se2.compose(se2.compose(se2.between(truth[a], truth[b]), middle), off)
    T_a_b = se2.compose(at_middle, se2.inverse(middle))
    x, y = at_middle[:2] - T_a_b[:2]
    back = np.array([[1.0, 0.0, y], [0.0, 1.0, -x], [0.0, 0.0, 1.0]])
    return MapEdge(a, b, T_a_b, back @ COVARIANCE @ back.T, probability)


def all_edges(truth, **options) -> list[MapEdge]:
    return [edge(truth, a, b, **options) for a, b in itertools.combinations(truth, 2)]


def errors(structure: Structure, truth) -> list[float]:
    found = {name: placed.T_group_map for group in structure.groups for name, placed in group.maps.items()}
    firsts = {name: next(iter(group.maps)) for group in structure.groups for name in group.maps}
    return [
        float(np.abs(se2.between(se2.between(truth[firsts[name]], truth[name]), pose)).max())
        for name, pose in found.items()
    ]


def test_exact_edges_give_the_exact_poses():
    truth = places(6)
    structure = connect(middles(truth), all_edges(truth))
    assert [list(group.maps) for group in structure.groups] == [list(truth)]
    assert not structure.withdrawn
    assert max(errors(structure, truth)) < 1e-6
    np.testing.assert_array_equal(structure.groups[0].maps["m0"].T_group_map, np.zeros(3))


def test_maps_without_edges_stay_apart_and_groups_apart():
    truth = places(5)
    structure = connect(middles(truth), [edge(truth, "m1", "m3"), edge(truth, "m4", "m2")])
    assert [list(group.maps) for group in structure.groups] == [["m0"], ["m1", "m3"], ["m2", "m4"]]
    assert max(errors(structure, truth)) < 1e-9


@pytest.mark.parametrize("probability", [0.951, 0.99, 0.9999])
def test_a_wrong_edge_is_withdrawn_however_sure_it_was(probability):
    truth = places(4)
    edges = [each for each in all_edges(truth, probability=0.96) if (each.a, each.b) != ("m0", "m1")]
    wrong = edge(truth, "m0", "m1", probability, off=(0.5, 0.0, np.pi))
    structure = connect(middles(truth), [wrong, *edges])
    assert [each.pair for each in structure.withdrawn] == [("m0", "m1")]
    assert "contradicts the way by m0 - m" in structure.withdrawn[0].reason
    assert max(errors(structure, truth)) < 1e-6


def test_a_triangle_that_contradicts_itself_loses_what_may_be_wrong():
    truth = places(3)
    edges = [edge(truth, "m0", "m1", 0.97), edge(truth, "m1", "m2", 0.97), edge(truth, "m0", "m2", 0.96, (2.0, 0, 0))]
    structure = connect(middles(truth), edges)
    assert len(structure.groups) == 3
    assert len(structure.withdrawn) == 3
    # Where two are far surer than the third, they stay.
    edges[:2] = [edge(truth, "m0", "m1", 0.9995), edge(truth, "m1", "m2", 0.9995)]
    structure = connect(middles(truth), edges)
    assert [each.pair for each in structure.withdrawn] == [("m0", "m2")]
    assert max(errors(structure, truth)) < 1e-6


def test_refinement_spreads_what_edges_disagree_by():
    """With all pairs the mean error is smaller than along the tree, and the covariance says how large it is."""
    truth, random = places(7), np.random.default_rng(2)
    tree_errors, graph_errors, normalised = [], [], []
    for _ in range(30):
        noisy = [
            edge(truth, a, b, off=random.standard_normal(3) * np.sqrt(np.diag(COVARIANCE) + FLOOR))
            for a, b in itertools.combinations(truth, 2)
        ]
        structure = connect(middles(truth), noisy)
        assert len(structure.groups) == 1
        for name, placed in structure.groups[0].maps.items():
            if name == "m0":
                continue
            true_pose = se2.between(truth["m0"], truth[name])
            error = placed.T_group_map - true_pose
            error[2] = se2.wrap_angle(error[2])
            normalised.append(float(error @ np.linalg.solve(placed.covariance, error)))
            middle = middles(truth)[name]
            apart = se2.transform_points(placed.T_group_map, middle) - se2.transform_points(true_pose, middle)
            graph_errors.append(np.hypot(*apart))
            direct = next(each for each in noisy if (each.a, each.b) == ("m0", name))
            apart = se2.transform_points(direct.T_a_b, middle) - se2.transform_points(true_pose, middle)
            tree_errors.append(np.hypot(*apart))
    assert np.mean(graph_errors) < 0.85 * np.mean(tree_errors)
    assert np.mean(normalised) == pytest.approx(3.0, rel=0.35)  # 3 degrees of freedom


def test_the_order_and_the_direction_of_edges_change_nothing():
    truth, random = places(6), np.random.default_rng(1)
    edges = [
        edge(truth, a, b, random.uniform(0.9, 0.999), random.normal(0.0, 0.02, 3) * [1, 1, 0.2])
        for a, b in itertools.combinations(truth, 2)
    ]
    edges[4] = edge(truth, "m0", "m5", 0.97, (6.0, 1.0, 1.5))
    expected = connect(middles(truth), edges)
    assert len(expected.withdrawn) == 1
    for _ in range(20):
        shuffled = connect(middles(truth), [edges[number] for number in random.permutation(len(edges))])
        for name, placed in expected.groups[0].maps.items():
            np.testing.assert_array_equal(shuffled.groups[0].maps[name].T_group_map, placed.T_group_map)
            np.testing.assert_array_equal(shuffled.groups[0].maps[name].covariance, placed.covariance)
    backwards = []
    for each in edges:
        jacobian = inverse_jacobian(each.T_a_b)
        covariance = jacobian @ each.covariance @ jacobian.T
        backwards.append(MapEdge(each.b, each.a, se2.inverse(each.T_a_b), covariance, each.probability))
    turned = connect(middles(truth), backwards)
    for name, placed in expected.groups[0].maps.items():
        np.testing.assert_allclose(turned.groups[0].maps[name].T_group_map, placed.T_group_map, atol=1e-6)


def test_another_map_changes_no_other_group():
    truth = places(6)
    edges = [edge(truth, "m1", "m2", off=(0.02, 0.0, 0.0)), edge(truth, "m2", "m4"), edge(truth, "m1", "m4")]
    before = connect({name: at for name, at in middles(truth).items() if name != "m0"}, edges)
    after = connect(middles(truth), [*edges, edge(truth, "m0", "m5")])
    one = next(group for group in before.groups if "m4" in group.maps)
    other = next(group for group in after.groups if "m4" in group.maps)
    for name, placed in one.maps.items():
        np.testing.assert_array_equal(other.maps[name].T_group_map, placed.T_group_map)


def test_the_covariance_of_a_map_is_carried_to_a_robot_in_it():
    T_group_map, T_map_robot = np.array([3.0, -2.0, 0.7]), np.array([12.0, 5.0, -1.1])
    deviations = np.array([0.03, 0.05, 0.01])
    off = np.random.default_rng(0).normal(size=(200_000, 3)) * deviations
    robots = se2.compose(T_group_map + off, np.broadcast_to(T_map_robot, off.shape))
    expected = np.cov((robots - se2.compose(T_group_map, T_map_robot)).T)
    found = carried_covariance(T_group_map, np.diag(deviations**2), T_map_robot)
    np.testing.assert_allclose(found, expected, rtol=0.02, atol=2e-5)
    assert found[0, 0] > deviations[0] ** 2  # the angle moves what is far from the map's origin
