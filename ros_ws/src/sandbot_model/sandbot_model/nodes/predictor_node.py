"""predictor: the model's prediction of the running trial - /model/speed at every leg state, /model/speed/mean,
/model/error, and /model/curve, its mean speed over all leg frequencies."""

import json
import math
from collections.abc import Mapping, Sequence

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from sandbot_common import messages, topics
from sandbot_common.files import parse_json
from sandbot_common.legs import leg_mount_rad
from sandbot_common.robot import Robot, difference, robot_from_mapping
from sandbot_common.ros import endpoints, node, ros_health, ros_parameters
from sandbot_model.physics.predictor import of_robot
from sandbot_model.predictor_parameters import PredictorParameters, predictor_of

NO_VARIANCE = -1.0
_OMEGA_RAD_S = np.arange(1.0, 40.5, 0.5)
"""The frequencies of the curve, to which that of the trial is added."""


class PredictorNode(Node):
    """Takes φ from the bed, ω and gait from /trial, leg angles from /leg_states; measured speeds give the error."""

    def __init__(self) -> None:
        super().__init__("predictor")
        self._settings = ros_parameters.Parameters(self, PredictorParameters, self._use)
        self._predictor = predictor_of(self._settings.current)
        self._robot: Robot | None = None
        self._drawn: object = None
        self._phi = self._omega = math.nan
        self._gait, self._leg_mount_rad = "", 0.0
        self._error = math.nan
        self._speed = endpoints.publisher(self, topics.MODEL_SPEED)
        self._mean = endpoints.publisher(self, topics.MODEL_SPEED_MEAN)
        self._difference = endpoints.publisher(self, topics.MODEL_ERROR)
        self._curve = endpoints.publisher(self, topics.MODEL_CURVE)
        endpoints.subscription(self, topics.TRIAL, self._on_trial)
        endpoints.subscription(self, topics.BED_PHI, self._on_phi)
        endpoints.subscription(self, topics.LEG_STATES, self._on_legs, best_effort=True)
        endpoints.subscription(self, topics.SPEED_MEAN, self._on_speed)
        self._health = ros_health.Health(self, self._figures)

    def _use(self, parameters: PredictorParameters) -> None:
        self._predictor, self._drawn = predictor_of(parameters), None
        self._use_robot_of_trial(parameters)

    def _on_trial(self, message: String) -> None:
        try:
            trial = parse_json(message.data, topics.TRIAL.name)
            self._omega, self._gait = float(trial["omega_rad_s"]), str(trial.get("gait", ""))
            self._leg_mount_rad = leg_mount_rad(trial, topics.TRIAL.name)
            if "robot" in trial:
                self._robot = robot_from_mapping(trial["robot"], "/trial: robot")
            self._use_robot_of_trial(self._settings.current)
            if math.isnan(self._phi) and "phi" in trial:
                self._phi = float(trial["phi"])
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
            self._health.level, self._health.text = 1, f"/trial can't be read: {type(error).__name__} {error}"
            return
        self._announce()

    def _use_robot_of_trial(self, parameters: PredictorParameters) -> None:
        """Predict for the trial's robot, unless the parameters name a robot's file or a result."""
        self._health.level, self._health.text = 0, "ok"
        robot, own = self._robot, self._predictor.model.robot
        if robot is None or robot == own:
            return
        if not parameters.robot and not parameters.result:
            self._predictor = of_robot(self._predictor, robot)
        else:
            self._health.level = 1
            self._health.text = f"predicts for another robot than that of /trial ({difference(own, robot)})"

    def _on_phi(self, message: Float64) -> None:
        self._phi = float(message.data)
        self._announce()

    def _announce(self) -> None:
        if self._known:
            self._mean.publish(messages.float64(self._predictor.mean_speed(self._phi, self._omega, self._gait)))
            self._draw()

    def _draw(self) -> None:
        """Publish the curve, once for each φ, gait and robot."""
        key = self._phi, self._omega, self._gait, self._predictor.model.robot
        if key == self._drawn:
            return
        self._drawn = key
        omega = np.union1d(_OMEGA_RAD_S, [self._omega])
        speed = self._predictor.mean_speeds(self._phi, omega, self._gait)
        curve = {"phi": self._phi, "gait": self._gait, "omega_rad_s": omega.tolist(), "speed_m_s": speed.tolist()}
        self._curve.publish(messages.string(json.dumps(curve)))

    def _on_legs(self, message: JointState) -> None:
        if not self._known or not 0 < len(message.position) == len(message.velocity):
            return
        angles, rates = np.array(message.position) + self._leg_mount_rad, np.array(message.velocity)
        here = self._predictor.velocity(self._phi, self._omega, self._gait, angles, rates)
        t_ns = messages.nanoseconds(message.header.stamp)
        self._speed.publish(messages.twist(t_ns, here.v_x, here.v_z, NO_VARIANCE, NO_VARIANCE))

    def _on_speed(self, message: Float64) -> None:
        if self._known:
            self._error = message.data - self._predictor.mean_speed(self._phi, self._omega, self._gait)
            self._difference.publish(messages.float64(self._error))
            self._announce()

    @property
    def _known(self) -> bool:
        return math.isfinite(self._phi) and math.isfinite(self._omega) and self._omega > 0

    def _figures(self) -> Mapping[str, object]:
        return {"phi": self._phi, "omega_rad_s": self._omega, "gait": self._gait, "error_m_s": self._error}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node."""
    return node.run(PredictorNode, argv)


if __name__ == "__main__":
    raise SystemExit(main())
