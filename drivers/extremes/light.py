"""The extremes of light."""

from __future__ import annotations

from evs.drivers.extremes.extreme import Extreme, Outcome
from evs.drivers.extremes.film import film
from evs.emulator import World

DARK = """<mujoco><visual><headlight active="0"/></visual><worldbody>
<camera name="eye" pos="0 -3 1" xyaxes="1 0 0 0 0.2 1"/>
<geom type="plane" size="0 0 1"/><body mocap="true"><geom type="sphere" size=".4"/></body>
</worldbody></mujoco>"""


def _nothing_lit(short: bool) -> Outcome:
    def move(tick: int, world: World) -> None:
        world.data.mocap_pos[0] = (0.01 * tick, 0, 0.5)

    seen = film(DARK, 0.02 if short else 0.1, act=move)
    said = tuple(line for line in seen.warnings if "sees nothing lit" in line)
    return Outcome(len(seen.events) + (len(said) != 1), 0, "events", said)


EXTREMES = (
    Extreme(
        "no-light",
        "light",
        "a ball moves where nothing shines",
        "no event: the light is 0 in every tick; one warning says that nothing is lit",
        _nothing_lit,
    ),
)
