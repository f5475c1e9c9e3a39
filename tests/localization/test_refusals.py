"""Who keeps saying otherwise than the estimate is named, with how far off it is and since when."""

from __future__ import annotations

import numpy as np

from grape.localization import Fusion, SensorOptions, components, per_component, reading_of_components
from grape.localization.refusals import Refusals


def test_a_discord_is_what_lasts() -> None:
    refusals = Refusals(patience=3)
    for k in range(2):
        refusals.note("gnss", 10.0 + k, 7.0, refused=True)
    assert refusals.discords == ()
    refusals.note("gnss", 12.0, 9.0, refused=True)
    (discord,) = refusals.discords
    assert (discord.source, discord.since, discord.sigma, discord.times) == ("gnss", 10.0, 9.0, 3)
    refusals.note("gnss", 13.0, 0.5, refused=False)
    assert refusals.discords == ()


def test_the_filter_names_the_sensor_that_jumped_until_it_comes_back() -> None:
    fusion = Fusion(
        {
            "wheels": SensorOptions(components=components("vx", "wz"), std=per_component(vx=0.02, wz=0.02)),
            "place": SensorOptions(
                components=components("x", "y"), std=per_component(x=0.02, y=0.02), pose_gate=5.0
            ),
        }
    )  # fmt: skip
    fusion.take(reading_of_components(0.0, "place", x=0.0, y=0.0))

    def second(k: int, off: float) -> None:
        for stamp in np.arange(k - 0.9, k + 0.05, 0.1):
            fusion.take(reading_of_components(float(stamp), "wheels", vx=0.0, wz=0.0))
        fusion.take(reading_of_components(k + 0.05, "place", x=off, y=0.0))

    for k in range(1, 6):
        second(k, 0.0)
    assert fusion.discords == ()
    for k in range(6, 12):
        second(k, 2.0)
    (discord,) = fusion.discords
    assert discord.source == "place" and discord.since == 6.05 and discord.times == 6 and discord.sigma > 5.0
    assert abs(fusion.belief().mean[0]) < 0.05
    second(12, 0.0)
    assert fusion.discords == ()
