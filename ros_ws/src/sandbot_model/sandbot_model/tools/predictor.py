"""The predictor's command line, which answers before ROS is imported."""

from sandbot_common import cli
from sandbot_model.physics.predictor import PredictorParameters

main = cli.node("sandbot_model.nodes.predictor_node", PredictorParameters)

if __name__ == "__main__":
    raise SystemExit(main())
