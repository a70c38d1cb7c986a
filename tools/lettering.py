"""Text in pictures, drawn with OpenCV: ASCII only, cut or wrapped to the room there is."""

from __future__ import annotations

import cv2

from tools.pictures import Image

INK_BGR = (40, 40, 40)
_WHITE_BGR = (255, 255, 255)
_PLAIN, _BOLD = cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX
_ASCII = str.maketrans(
    {"–": "-", "—": "-", "−": "-", "°": " deg", "±": "+-", "×": "x", "²": "2", "ω": "omega", "τ": "tau", "α": "alpha",
     "σ": "sigma", "≤": "<=", "≥": ">=", "→": "->", "‘": "'", "’": "'", "“": '"', "”": '"', "…": "..."}
)  # fmt: skip


def to_ascii(text: str) -> str:
    """Return the text on one line in the letters that OpenCV has; what it lacks becomes a question mark."""
    return " ".join(text.translate(_ASCII).encode("ascii", errors="replace").decode("ascii").split())


def text_width_px(text: str, scale: float, *, bold: bool = False) -> int:
    """Return how wide a text is."""
    font, thickness = _style(scale, bold=bold)
    return int(cv2.getTextSize(text, font, scale, thickness)[0][0])


def fitted(text: str, width_px: int, scale: float, *, bold: bool = False) -> str:
    """Return the text, or as much of it as fits the width, ending in dots."""
    text = to_ascii(text)
    if text_width_px(text, scale, bold=bold) <= width_px:
        return text
    kept = len(text)
    while kept and text_width_px(text[:kept].rstrip() + "...", scale, bold=bold) > width_px:
        kept -= 1
    return text[:kept].rstrip() + "..."


def wrapped(text: str, width_px: int, scale: float, most_lines: int) -> list[str]:
    """Return the text in lines no wider than the width; what exceeds the number of lines is cut, with dots."""
    lines: list[str] = []
    words = to_ascii(text).split()
    while words and len(lines) < most_lines - 1:
        taken = 1
        while taken < len(words) and text_width_px(" ".join(words[: taken + 1]), scale) <= width_px:
            taken += 1
        lines.append(fitted(" ".join(words[:taken]), width_px, scale))
        words = words[taken:]
    return [*lines, fitted(" ".join(words), width_px, scale)] if words else lines


def write_text(
    image: Image,
    text: str,
    left_base: tuple[float, float],
    scale: float = 0.5,
    color: tuple[int, int, int] = INK_BGR,
    *,
    bold: bool = False,
    halo: bool = False,
) -> None:
    """Draw a text into the picture; left_base is the left end of its base line in pixels; halo: on a white rim."""
    font, thickness = _style(scale, bold=bold)
    at = (round(left_base[0]), round(left_base[1]))
    if halo:
        cv2.putText(image, to_ascii(text), at, font, scale, _WHITE_BGR, thickness + 4, cv2.LINE_AA)
    cv2.putText(image, to_ascii(text), at, font, scale, color, thickness, cv2.LINE_AA)


def _style(scale: float, *, bold: bool) -> tuple[int, int]:
    """Return OpenCV's font and the width of its strokes."""
    return (_BOLD, max(1, round(scale * 1.6))) if bold else (_PLAIN, 1)
