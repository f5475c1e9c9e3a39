"""Refilling in the simulated world: when the operator comes, what he puts in, and that a kill changes nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grape.robots.husky_jaco2 import DESCRIPTION
from grape.sim.drivers import SensorOptions
from grape.sim.drivers.operator import OperatorOptions
from grape.sim.hanging import DispenserPlace
from grape.sim.simulation import Simulation, SimulationOptions
from grape.sim.worlds import VineyardOptions, generate_vineyard

QUICK = OperatorOptions(fill=3, after_s=(0.4, 1.2), confirm_s=0.3)


@pytest.fixture(scope="module")
def world():
    """Level ground; the robot starts at the refill point."""
    grown = generate_vineyard(
        VineyardOptions(rows=1, vines_per_row=2, nails_per_row=1, weeds=0.0, slope=0.0, roughness_rms=0.0)
    )
    point = grown.site.refills[0]
    site = replace(grown.site, start=point.position, start_heading_rad=point.yaw_rad)
    return replace(grown, site=site)


@pytest.fixture
def simulate(world):
    made = []

    def build(seed=1, dispensers=1, stock=3, operator=QUICK, settle_s=0.3, **more):
        options = SimulationOptions(
            dispensers=dispensers, stock=stock, settle_s=settle_s, sensors=SensorOptions(operator=operator), **more
        )
        made.append(Simulation(world, DESCRIPTION, seed=seed, options=options))
        return made[-1]

    yield build
    for simulation in made:
        simulation.close()


def call(simulation, seconds):
    """Seconds of calling; the time (s) of the first confirmation, None without one."""
    for _ in range(round(100 * seconds)):
        simulation.drivers.operator.call()
        simulation.advance()
        if told := simulation.drivers.operator.refilled():
            return told[0].stamp
    return None


def where(simulation):
    return [place.where for place in simulation.referee._judge.places()]


STOCK, FEEDER, DROPPED = DispenserPlace.STOCK, DispenserPlace.FEEDER, DispenserPlace.DROPPED


def test_the_operator_fills_the_empty_levels_and_says_how_many(simulate):
    simulation = simulate()
    data, loops = simulation._physics.data, simulation.referee._judge._loops
    assert where(simulation) == [FEEDER, STOCK, STOCK, STOCK]
    assert simulation.referee.verdict()["truth"]["loaded"] == 1
    assert call(simulation, 2.0) is not None
    (told,) = simulation.drivers.operator.refilled()
    assert (told.number, told.added) == (1, 2), "up to three"
    assert simulation.drivers.operator.refilled(after=1) == ()
    for _ in range(50):
        simulation.advance()
    assert where(simulation) == [FEEDER, FEEDER, FEEDER, STOCK]
    heights = [loops[k].polyline(data)[:, 2].mean() for k in range(3)]
    assert np.diff(heights) == pytest.approx([DESCRIPTION.feeder.pitch] * 2, abs=0.002), "each lies on its level"
    truth = simulation.referee.verdict()["truth"]
    assert (truth["loaded"], truth["in_feeder"], truth["dropped"]) == (3, 3, 0)
    for _ in range(150):
        simulation.drivers.base.send(0.6, 0.3)
        simulation.advance()
    assert where(simulation) == [FEEDER, FEEDER, FEEDER, STOCK], "they ride along"
    model = simulation._physics.model
    assert [bool(data.body_awake[model.body(f"dispenser_{k}").id]) for k in range(4)] == [True] * 3 + [False]


def test_nobody_comes_uncalled_or_elsewhere_or_while_something_moves(simulate):
    uncalled = simulate()
    for _ in range(200):
        uncalled.advance()
    assert uncalled.drivers.operator.refilled() == () and where(uncalled)[1] is STOCK
    moving = simulate()
    for _ in range(200):
        moving.drivers.operator.call()
        moving.drivers.arm.send(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.1]))
        moving.advance()
    assert moving.drivers.operator.refilled() == ()
    elsewhere = simulate()
    elsewhere._drivers.operator._points = (replace(elsewhere.world.site.refills[0], position=np.array([0.0, 3.0])),)
    assert call(elsewhere, 2.0) is None


def test_a_hand_in_the_feeder_is_waited_for(simulate):
    simulation = simulate()
    operator = simulation._drivers.operator
    assert operator._may_work()
    operator._options = replace(QUICK, clear_m=0.3)
    assert not operator._may_work(), "in the travel pose the hand is less than 0.3 m over the feeder"


def test_without_more_dispensers_the_operator_says_none(simulate):
    simulation = simulate(dispensers=0, stock=1)
    assert call(simulation, 2.0) is not None
    for _ in range(200):
        simulation.drivers.operator.call()
        simulation.advance()
    assert [told.added for told in simulation.drivers.operator.refilled()] == [1, 0]


def test_the_operator_may_miscount(simulate):
    simulation = simulate(operator=replace(QUICK, miscount=1))
    call(simulation, 2.0)
    assert simulation.drivers.operator.refilled()[0].added == 3 and where(simulation).count(FEEDER) == 3


def test_the_time_he_takes_comes_from_the_seed(simulate):
    first, again, other = (call(simulate(seed=seed), 2.0) for seed in (1, 1, 2))
    assert first == again != other
    assert all(0.7 <= stamp <= 1.8 for stamp in (first, other))


def test_dispensers_in_stock_change_nothing(simulate):
    with_stock, without = simulate(), simulate(stock=0)
    for simulation in (with_stock, without):
        for _ in range(50):
            simulation.drivers.base.send(0.4, 0.2)
            simulation.advance()
    n = without._physics.model.nq
    assert np.abs(with_stock._physics.data.qpos[:n] - without._physics.data.qpos).max() < 1e-6


@pytest.mark.parametrize("beats", [40, 110, 150])
def test_a_kill_before_between_or_after_changes_nothing(simulate, tmp_path, beats):
    """Called for two seconds: 0.4 to 1.2 s until the dispensers are in, 0.3 s until he says so."""

    def go(simulation, first, last):
        for _ in range(first, last):
            simulation.drivers.operator.call()
            simulation.drivers.base.send(0.0, 0.0)
            simulation.advance()

    whole = simulate()
    go(whole, 0, 200)
    killed = simulate()
    killed.keep(tmp_path / "world")
    go(killed, 0, beats)
    resumed = simulate()
    assert resumed.keep(tmp_path / "world")
    go(resumed, beats, 200)
    assert resumed._physics.data.qpos.tobytes() == whole._physics.data.qpos.tobytes()
    assert resumed.drivers.operator.refilled() == whole.drivers.operator.refilled() != ()
    assert where(resumed) == where(whole) == [FEEDER, FEEDER, FEEDER, STOCK]


def test_the_camera_sees_dispensers_that_were_put_in(simulate):
    simulation = simulate(dispensers=0, arm_pose="ready_feeder")

    def red():
        bgr = simulation.drivers.camera.latest().bgr.astype(int)
        return int(((bgr[..., 2] > 120) & (bgr[..., 1] < 40) & (bgr[..., 0] < 40)).sum())

    for _ in range(20):
        simulation.advance()
    before = red()
    call(simulation, 2.0)
    for _ in range(30):
        simulation.advance()
    assert red() > before + 300, "the wings of the topmost"
