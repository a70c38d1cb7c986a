"""Questions whose answers depend on the model alone; the emulator's own tests ask the rest."""

from __future__ import annotations

import pytest

from drivers.rplidar_answers import answer, board_answer, boot_text, conf_entry, split_requests
from drivers.rplidar_models import MODELS
from drivers.rplidar_protocol import Command, Conf, Health, conf_request, conf_value, parse_health, parse_info, request


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_what_is_answered_can_be_parsed(model) -> None:
    info = parse_info(answer(model, Health(0, 0), Command.GET_INFO, b"")[7:])
    assert (info.model, info.firmware, info.serial) == (model.name, model.firmware, model.serial.hex().upper())
    assert parse_health(answer(model, Health(2, 0x8001), Command.GET_HEALTH, b"")[7:]) == Health(2, 0x8001)
    assert answer(model, Health(0, 0), Command.STOP, b"") == b""
    assert boot_text(model).endswith(f"Model: {model.model_id:02X}".encode())


def test_conf_echoes_the_entry_in_front_of_its_value() -> None:
    model = MODELS["A2M6"]
    ((command, payload),), _ = split_requests(conf_request(Conf.MODE_NAME, 2))
    value = conf_value(answer(model, Health(0, 0), command, payload)[7:], Conf.MODE_NAME)
    assert value == conf_entry(model, Conf.MODE_NAME, b"\2\0") == b"Boost\0"
    assert conf_entry(model, 0x99, b"") is None


def test_the_board_drives_the_motor() -> None:
    assert board_answer() == bytes.fromhex("A55A04000000FF01000000")


def test_requests_are_found_amid_noise_and_half_of_one_is_kept() -> None:
    noise, half = b"\xa5\x00\xff", conf_request(Conf.MODE_COUNT)[:4]
    assert split_requests(noise + request(Command.STOP) + half) == ([(Command.STOP, b"")], half)
