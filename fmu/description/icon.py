"""The icon of an FMU that we make: its wheels from above, and the path around a box for the controller."""

import io

from PIL import Image, ImageDraw

SIZE = 128
"""Width and height, in pixels."""

_FINE = 4  # drawn larger and shrunk: smooth edges
_PAPER, _BODY, _WHEEL, _PATH, _BOX = "white", "#d9e2ec", "#243b53", "#1f77b4", "#d62728"
_WHEELS = {  # wheel centres and whether they steer, in parts of the size, forward up
    "single_track": ((0.5, 0.25, True), (0.5, 0.75, False)),
    "linear": ((0.5, 0.25, True), (0.5, 0.75, False)),
    "double_track": ((0.32, 0.25, True), (0.68, 0.25, True), (0.32, 0.75, False), (0.68, 0.75, False)),
}


def draw_icon(identifier: str) -> bytes:
    """A PNG file for the FMU with this model identifier."""
    image = Image.new("RGB", (SIZE * _FINE, SIZE * _FINE), _PAPER)
    draw = ImageDraw.Draw(image)
    if identifier in _WHEELS:
        _draw_car(draw, _WHEELS[identifier])
    else:
        _draw_evasion(draw)
    file = io.BytesIO()
    image.resize((SIZE, SIZE), Image.Resampling.LANCZOS).save(file, "PNG")
    return file.getvalue()


def _draw_car(draw: ImageDraw.ImageDraw, wheels: tuple[tuple[float, float, bool], ...]) -> None:
    full = SIZE * _FINE
    width = 0.22 if len(wheels) > 2 else 0.08
    draw.rounded_rectangle(
        [(0.5 - width) * full, 0.08 * full, (0.5 + width) * full, 0.92 * full], 0.08 * full, fill=_BODY
    )
    for x, y, steers in wheels:
        lean = 0.05 if steers else 0.0  # to the left
        corners = [(-0.05, -0.12), (0.05, -0.12), (0.05, 0.12), (-0.05, 0.12)]
        draw.polygon([((x + u + lean * v / 0.12) * full, (y + v) * full) for u, v in corners], fill=_WHEEL)


def _draw_evasion(draw: ImageDraw.ImageDraw) -> None:
    full = SIZE * _FINE
    draw.rectangle([0.52 * full, 0.36 * full, 0.8 * full, 0.62 * full], fill=_BOX)
    for k in range(201):
        t = k / 100 - 1.0  # there and back
        s = 1.0 - (3.0 - 2.0 * abs(t)) * t * t
        x, y, r = (0.66 - 0.36 * s) * full, (0.5 - 0.45 * t) * full, 0.03 * full
        draw.ellipse([x - r, y - r, x + r, y + r], fill=_PATH)
