"""What a vehicle's parameters say about its own safety nets, in words: read before the first drive.

Meanings and defaults from ArduPilot's parameter list for Rover; the first two nets are off as delivered.
"""

from __future__ import annotations

from collections.abc import Mapping

SETPOINT_TIMEOUT = "GUID_TIMEOUT"
ARDUROVER_SETPOINT_TIMEOUT_S = 3.0  # built in where the parameter is missing

# Asked for after connecting; a vehicle that does not know one leaves it out.
PARAMETERS = (
    SETPOINT_TIMEOUT,
    "FS_GCS_ENABLE",
    "FS_TIMEOUT",
    "FS_ACTION",
    "FS_CRASH_CHECK",
    "FENCE_ENABLE",
    "SYSID_MYGCS",
    "ARMING_CHECK",
    "VISO_TYPE",
    "EK3_SRC1_POSXY",
    "EK3_SRC1_VELXY",
    "EK3_SRC1_YAW",
    "PRX1_TYPE",
)
_EXTERNAL_NAVIGATION, _MAVLINK_PROXIMITY, _VISION_BY_MAVLINK = 6, 2, (1, 3)


def checklist(parameters: Mapping[str, float], system: int) -> tuple[str, ...]:
    """Return one line for each net that is off or missing: what it is, and what to set. system: our MAVLink system."""
    found = [
        text
        for name, good, text in (
            ("FS_GCS_ENABLE", 1, "the vehicle does not stop when our heartbeats end: set FS_GCS_ENABLE 1"),
            ("FS_CRASH_CHECK", 1, "the vehicle does not stop when it runs into something: set FS_CRASH_CHECK 1"),
            ("FENCE_ENABLE", 1, "there is no fence around the vehicle: set FENCE_ENABLE 1 and a fence"),
        )
        if parameters.get(name, good) < good
    ]
    if parameters.get("FS_GCS_ENABLE", 0) >= 1 and parameters.get("FS_ACTION", 2) == 0:
        found.append("a failsafe has no consequence: set FS_ACTION 2 (hold)")
    if (listens := parameters.get("SYSID_MYGCS")) is not None and int(listens) != system:
        found.append(
            f"the heartbeat failsafe listens to system {int(listens)}, we are {system}: set SYSID_MYGCS {system}"
        )
    if parameters.get("ARMING_CHECK", 1) == 0:
        found.append("the vehicle arms without its own checks: set ARMING_CHECK 1")
    timeout_s = parameters.get(SETPOINT_TIMEOUT)
    if timeout_s is not None and not 0 < timeout_s <= ARDUROVER_SETPOINT_TIMEOUT_S:
        found.append(f"the vehicle drives on for {timeout_s:g} s without commands: set {SETPOINT_TIMEOUT} to 1 to 3")
    return (*found, *_unheard(parameters))


def _unheard(parameters: Mapping[str, float]) -> list[str]:
    """Return what the vehicle would not make use of."""
    found = []
    if "VISO_TYPE" in parameters and parameters["VISO_TYPE"] not in _VISION_BY_MAVLINK:
        found.append("our pose is not listened to: set VISO_TYPE 1 and reboot")
    if any(parameters.get(f"EK3_SRC1_{what}", 6) != _EXTERNAL_NAVIGATION for what in ("POSXY", "VELXY", "YAW")):
        found.append("our pose is not what the vehicle goes by: set EK3_SRC1_POSXY, EK3_SRC1_VELXY and EK3_SRC1_YAW 6")
    if "PRX1_TYPE" in parameters and parameters["PRX1_TYPE"] != _MAVLINK_PROXIMITY:
        found.append("our obstacles are not listened to: set PRX1_TYPE 2 and reboot")
    return found
