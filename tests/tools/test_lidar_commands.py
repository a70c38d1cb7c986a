"""`bench lidar` and `evaluate lidar` from end to end."""

from __future__ import annotations

import json

from tools.lidar_peers import PEERS, installed_peers


def test_bench_lidar_says_what_is_simulated_and_what_is_missing(cli):
    ended = cli("bench", "lidar", "--samples", "10000", "--seconds", "0")
    assert ended.code == 0, ended.err
    assert "(simulated)" in ended.out
    for peer in set(PEERS) - set(installed_peers()):
        assert f"{peer} is not installed" in ended.out
    report = json.loads(cli("bench", "lidar", "--samples", "10000", "--seconds", "0", "--json").out)
    assert report["simulated"] is True
    assert len(report["speeds"]) == 5


def test_evaluate_lidar_counts_faults_beside_theory(cli):
    ended = cli("evaluate", "lidar", "--samples", "5000", "--json")
    assert ended.code == 0, ended.err
    report = json.loads(ended.out)
    assert len(report["costs"]) == 25
    assert all(cost["false_turns"] == 0 for cost in report["costs"])
    assert all(entry["unnoticed"] == 0 for entry in report["single"].values())


def test_evaluate_lidar_prints_one_row_a_fault(cli):
    ended = cli("evaluate", "lidar", "--samples", "5000", "--seed", "2")
    assert ended.out.count("mixed") == 5
    assert ended.out.count("0 not noticed") == 4


def test_evaluate_lidar_feeds_noise(cli):
    ended = cli("evaluate", "lidar", "--fuzz", "0.5", "--json")
    assert ended.code == 0, ended.err
    assert json.loads(ended.out)["streams"] >= 1
