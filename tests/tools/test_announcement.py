"""One line an event."""

import json

from tools.announcement import announce


def test_as_text_and_as_json(capsys) -> None:
    announce(False, "ready", address="/dev/pts/3", baud=115200)
    announce(True, "ready", address="/dev/pts/3", baud=115200)
    text, line = capsys.readouterr().out.splitlines()
    assert text == "ready  address /dev/pts/3  baud 115200"
    assert json.loads(line) == {"event": "ready", "address": "/dev/pts/3", "baud": 115200}
