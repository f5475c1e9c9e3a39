"""Hanging pheromone dispensers on vines and nails: the task's actions, perception, missions and success criteria."""

from pathlib import Path

import grape.trees
from grape.actions.drive_to_pose import drive_to_pose
from grape.actions.move_arm import move_arm_to_named
from grape.actions.recoveries import back_off, leave_fence, turn, wait
from grape.actions.retract import retract
from grape.actions.take_picture import take_picture
from grape.actions.unwind import unwind
from grape.actions.wait_for_localization import wait_for_localization
from grape.plugins import Task
from grape.tasks.dispenser.actions.approach_nail import approach_nail
from grape.tasks.dispenser.actions.approach_spur import approach_spur
from grape.tasks.dispenser.actions.calibrate_arm import calibrate_arm
from grape.tasks.dispenser.actions.check_deployment import check_deployment
from grape.tasks.dispenser.actions.check_feeder import check_feeder
from grape.tasks.dispenser.actions.check_grasp import check_grasp
from grape.tasks.dispenser.actions.check_hand import check_hand
from grape.tasks.dispenser.actions.drive_to_plant import drive_to_plant
from grape.tasks.dispenser.actions.drive_to_refill import drive_to_refill
from grape.tasks.dispenser.actions.find_deployment_points import find_deployment_points
from grape.tasks.dispenser.actions.finish_plant import finish_plant
from grape.tasks.dispenser.actions.grasp_dispenser import grasp_dispenser
from grape.tasks.dispenser.actions.hang_dispenser import hang_dispenser
from grape.tasks.dispenser.actions.holds_dispenser import holds_dispenser
from grape.tasks.dispenser.actions.lower_onto_target import lower_onto_target
from grape.tasks.dispenser.actions.next_plant import next_plant
from grape.tasks.dispenser.actions.next_target import next_target
from grape.tasks.dispenser.actions.recall_targets import recall_targets
from grape.tasks.dispenser.actions.scan_vine import scan_vine
from grape.tasks.dispenser.actions.servo_to_feeder import servo_to_feeder
from grape.tasks.dispenser.actions.servo_to_nail import servo_to_nail
from grape.tasks.dispenser.actions.servo_to_spur import servo_to_spur
from grape.tasks.dispenser.actions.settle_account import settle_account
from grape.tasks.dispenser.actions.skip_plants import skip_plants
from grape.tasks.dispenser.actions.wait_for_refill import wait_for_refill
from grape.tasks.dispenser.actions.withdraw_hand import withdraw_hand
from grape.tasks.dispenser.conditions import (
    dispensers_left,
    interrupted,
    is_deployed,
    mode_is,
    plants_left,
    reason_is_one_of,
    refill_awaits,
    remembers_targets,
)

TASK = Task(
    name="dispenser",
    summary="Hangs pheromone dispensers on vines and nails.",
    actions=(
        approach_nail,
        approach_spur,
        back_off,
        calibrate_arm,
        check_deployment,
        check_feeder,
        check_grasp,
        check_hand,
        drive_to_plant,
        drive_to_pose,
        drive_to_refill,
        find_deployment_points,
        finish_plant,
        grasp_dispenser,
        hang_dispenser,
        holds_dispenser,
        leave_fence,
        lower_onto_target,
        move_arm_to_named,
        next_plant,
        next_target,
        recall_targets,
        retract,
        scan_vine,
        servo_to_feeder,
        servo_to_nail,
        servo_to_spur,
        settle_account,
        skip_plants,
        take_picture,
        turn,
        unwind,
        wait,
        wait_for_localization,
        wait_for_refill,
        withdraw_hand,
    ),
    conditions=(
        dispensers_left,
        interrupted,
        is_deployed,
        mode_is,
        plants_left,
        reason_is_one_of,
        refill_awaits,
        remembers_targets,
    ),
    trees={"dispenser_deployment": Path(grape.trees.__file__).with_name("dispenser_deployment.xml")},
    missions={path.stem: path for path in sorted((Path(__file__).parent / "missions").glob("*.yaml"))},
)

__all__ = ["TASK"]
