"""What the servo experiments share: trials that can be stopped and gone on with, their statistics and their plots."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grape.errors import ActionFailed
from grape.experiments.arm_bench import ArmBench
from grape.geometry import pose_error
from grape.messages import Array
from grape.mission.report_servo import ServoRun, image_plane, servo_runs
from grape.mission.svg import PALETTE, line_chart
from grape.proof import Figure, Quantity, wilson95
from grape.sim.worlds import VineyardOptions

START_M, START_RAD = 0.05, np.radians(10.0)  # how far off a run begins, besides what the arm errs
DRAWS = 40  # of a start pose, until the arm gets there
SHOWN = 12  # runs whose error over time is drawn
Progress = Callable[[float, str], None]
Trial = dict[str, Any]


@dataclass(frozen=True, kw_only=True, order=True)
class Key:
    """One trial. Attributes: case: its conditions; seed: of world, noise, arm errors and start."""

    case: str
    seed: int


def small_world(seed: int, **light: Any) -> VineyardOptions:
    """One short row with a vine on each side of a nail, on level ground."""
    return VineyardOptions(seed=seed, rows=1, vines_per_row=2, nails_per_row=1, slope=0.0, roughness_rms=0.0, **light)


def moved_start(rng: np.random.Generator, T_base_hand: Array) -> Array:
    """A hand pose (4, 4) up to 5 cm and 10 degrees beside another, even in volume and in angle."""
    from grape.geometry import pose, rotation_exp

    shift, axis = rng.normal(size=3), rng.normal(size=3)
    shift *= START_M * rng.uniform() ** (1 / 3) / np.linalg.norm(shift)
    turn = rotation_exp(axis * START_RAD * rng.uniform() / np.linalg.norm(axis))
    return pose(turn @ T_base_hand[:3, :3], T_base_hand[:3, 3] + shift)


def attempt(bench: ArmBench, servo: Any, judge: Callable[[], Mapping[str, float]]) -> Trial:
    """One servo action, and where the hand really was before and after.

    Args:
        servo: the action's generator.
        judge: tells the true errors once the action is over.
    """
    begin = bench.ctx.clock.now()
    arm_off = pose_error(bench.true_hand(), bench.robot.hand_pose(bench.ctx.world.joints()))
    trial: Trial = {"reason": "", "arm_off_mm": 1e3 * float(np.linalg.norm(arm_off[:3]))}
    try:
        bench.run(servo)
    except ActionFailed as failed:
        trial |= {"reason": str(failed.reason), "detail": failed.detail}
    ends = bench.log.of("servo")
    return trial | {
        "converged": not trial["reason"],
        **judge(),
        "error_px": ends[-1]["error_px"] if ends else None,
        "runs": len(ends),
        "looked_around": len(bench.log.of("look_around")),
        "duration_s": bench.ctx.clock.now() - begin,
        "collisions": [[c.a, c.b, round(c.force_n, 1)] for c in bench.simulation.referee.collisions],
        "events": [{"kind": kind, **fields} for kind, fields in bench.log.events if kind.startswith("servo")],
    }


def pose_judgement(T: Array, T_wanted: Array, p_hand: Array) -> Mapping[str, float]:
    """How far a hand pose (4, 4) is from the right one: its origin, its orientation, and its point `p_hand` (3,) m."""
    error = pose_error(T, T_wanted)
    point = error[:3] + (T[:3, :3] - T_wanted[:3, :3]) @ p_hand
    return {
        "hand_mm": 1e3 * float(np.linalg.norm(error[:3])),
        "hand_deg": float(np.degrees(np.linalg.norm(error[3:]))),
        "point_mm": 1e3 * float(np.linalg.norm(point)),
    }


def go_to_start(
    bench: ArmBench, rng: np.random.Generator, line: Sequence[Array], fingers: float, **around: Any
) -> None:
    """Moves the hand beside the first pose of a line, at random; to that pose itself when nothing else is reached.

    Args:
        line: hand poses (4, 4) in base_link, as `move_to_pose` takes them.
        fingers: rad, the angle of fingers 2 and 3 meanwhile.
        around: what `move_to_pose` is told of things around.
    """
    from grape.actions.move_arm import move_to_pose

    with bench.ctx.arm.lease("start") as arm, bench.ctx.gripper.lease("start") as gripper:
        gripper.send(np.array([bench.robot.description.gripper.thumb_clear, fingers, fingers]))
        for _ in range(DRAWS):
            start = (moved_start(rng, line[0]), *line[1:])
            try:
                bench.run(move_to_pose(bench.ctx, arm, start, status="to the start", **around))
                return
            except ActionFailed:
                continue
        bench.run(move_to_pose(bench.ctx, arm, line, status="to the start", **around))


def run_trials(
    folder: Path, keys: Sequence[Key], run: Callable[[Key], Trial], progress: Progress
) -> Mapping[Key, Trial]:
    """Every trial, one JSON line each in `trials.jsonl`; those that stand there are not run again."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "trials.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    done = {Key(case=line["case"], seed=line["seed"]): line for line in map(json.loads, filter(_complete, lines))}
    with path.open("a", encoding="utf-8") as file:
        for k, key in enumerate(keys):
            if key not in done:
                progress(k / len(keys), f"{key.case}, seed {key.seed}")
                done[key] = {"case": key.case, "seed": key.seed, **run(key)}
                file.write(
                    "\n" * bool(lines and not _complete(lines[-1])) + json.dumps(done[key], default=_plain) + "\n"
                )
                file.flush()
                lines = []
    return {key: done[key] for key in keys}


def _complete(line: str) -> bool:
    """Whether a line was written to its end before somebody stopped the experiment."""
    try:
        return isinstance(json.loads(line), dict)
    except json.JSONDecodeError:
        return False


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


def rate(name: str, trials: Sequence[Trial], *, reference: str = "", goal: str = "") -> Quantity:
    """Share of the trials that converged."""
    yes = sum(trial["converged"] for trial in trials)
    share = yes / len(trials) if trials else None
    return Quantity(name=name, unit="1", value=share, n=len(trials), ci95=wilson95(yes, len(trials)),
                    reference=reference, goal=goal)  # fmt: skip


def quantile(
    name: str, unit: str, trials: Sequence[Trial], key: str, q: float, *, reference: str = "", goal: str = ""
) -> Quantity:
    """A quantile of one figure over the trials that converged, with its bootstrap interval."""
    values = np.array([trial[key] for trial in trials if trial["converged"]], float)
    if not values.size:
        return Quantity(name=name, unit=unit, value=None, n=0, reference=reference, goal=goal)
    draws = np.random.default_rng(0).choice(values, (2000, values.size))
    low, high = np.quantile(np.quantile(draws, q, axis=1), (0.025, 0.975))
    return Quantity(name=name, unit=unit, value=float(np.quantile(values, q)), n=values.size,
                    ci95=(float(low), float(high)), reference=reference, goal=goal)  # fmt: skip


def open_loop_and_time(trials: Sequence[Trial]) -> tuple[Quantity, ...]:
    """What every servo experiment tells: how far off the arm alone is, how long it takes, who had to look around."""
    looked = [trial | {"converged": bool(trial["looked_around"])} for trial in trials]
    return (
        quantile("open loop: what the arm is off at the start, median", "mm", trials, "arm_off_mm", 0.5,
                 reference="0 to 50 mm"),
        quantile("open loop: what the arm is off at the start, 95th percentile", "mm", trials, "arm_off_mm", 0.95,
                 reference="0 to 50 mm"),
        quantile("duration, median", "s", trials, "duration_s", 0.5),
        rate("began out of view and looked around", looked),
    )  # fmt: skip


def marker_quantities(trials: Sequence[Trial], reference: str) -> tuple[Quantity, ...]:
    """What servoing on markers is measured by; `reference`: what the source shows."""
    return (
        rate("converged", trials, reference=reference),
        quantile("corner error, 95th percentile", "px", trials, "error_px", 0.95, goal="<= 1"),
        quantile("hand position error, median", "mm", trials, "hand_mm", 0.5, reference="1 mm needed"),
        quantile("hand position error, 95th percentile", "mm", trials, "hand_mm", 0.95, goal="<= 2"),
        quantile("error at the nails, 95th percentile", "mm", trials, "point_mm", 0.95),
        *open_loop_and_time(trials),
    )


def convergence_figures(trials: Iterable[Trial], what: str, feature: str = "corner") -> tuple[Figure, ...]:
    """Paths of the features in the image of the first trial, and the error over the frames of the first dozen."""
    found = [(str(trial["seed"]), run) for trial in trials for run in servo_runs(trial["events"])[-1:]][:SHOWN]
    runs = [run for _, run in found]
    if not runs:
        return ()
    lines = [(seed, _seen(run), PALETTE[k % len(PALETTE)]) for k, (seed, run) in enumerate(found)]
    chart = line_chart(lines, x_title="iteration", y_title="error, px", width=560, height=300)
    return (
        Figure(
            title=f"{what}: paths of the {feature}s in the image, from start (ring) to end (dot), cross: desired",
            svg=image_plane(runs[0]),
        ),
        Figure(title=f"{what}: {feature} error over the iterations (frames), {len(runs)} runs by seed", svg=chart),
    )


def _seen(run: ServoRun) -> list[tuple[float, float]]:
    """Number and error in px of the frames that showed the feature."""
    return [(float(k), error) for k, error in enumerate(run.errors) if np.isfinite(error)]
