"""The deadlines of a MAVLink connection."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MavlinkSettings:
    """Deadlines in s. repeat_s: between setpoints; command_life_s: how long one drive() call is repeated.

    lost_after_s: of silence. connect_s: for the first heartbeat. answer_s: for one answer, asked for `attempts` times.
    telemetry_hz: of wheel odometry and IMU, which the vehicle is asked for. echo_s: between the questions that only
    show whether the vehicle hears us (TIMESYNC); unheard_after_s: of a question without an answer.
    """

    repeat_s: float = 0.05
    command_life_s: float = 0.5
    lost_after_s: float = 2.5
    connect_s: float = 5.0
    answer_s: float = 1.0
    attempts: int = 3
    telemetry_hz: float = 20.0
    standing_s: float = 1.0  # how long standstill is repeated after a stop
    echo_s: float = 0.1
    unheard_after_s: float = 0.4
