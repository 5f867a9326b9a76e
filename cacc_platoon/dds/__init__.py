"""How DDS is set up on this machine: environment, domains, shared memory; no rclpy."""
