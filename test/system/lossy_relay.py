"""A noise relay started by hand that loses every third sample, and says so."""

import sys

from std_msgs.msg import Int64

from cacc_platoon.nodes import executables, qos
from cacc_platoon.nodes.noise_relay import NoiseRelayNode


class LossyRelayNode(NoiseRelayNode):
    def create_stream(self, topic):
        deliver = super().create_stream(topic)
        lost = self.create_publisher(Int64, self.topics.complete, qos.stream(self.scenario))

        def send(stamp: int, acceleration: float) -> None:
            if stamp // self.scenario.step_ns % 3:
                deliver(stamp, acceleration)
            else:
                lost.publish(Int64(data=stamp))

        return send


if __name__ == "__main__":
    executables.NoiseRelayNode = LossyRelayNode
    sys.exit(executables.noise_relay())
