"""A cable in user space that delays, loses and reorders packets, where the kernel has no netem.

  lossy_wire.py NEAR FAR --loss 0.05 --delay 0.001 0.01 --seed 1

It makes two TAP devices, says "up", and carries frames between them until standard input closes.
Every frame is lost, or delayed by a time of its own, as a seeded generator says; so later ones
overtake. The caller moves FAR to where it belongs.
"""

from __future__ import annotations

import argparse
import fcntl
import heapq
import os
import random
import select
import struct
import sys
import time

TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
FRAME = 65536


def tap(name: str) -> int:
    """Make a TAP device and return its file."""
    file = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(file, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
    return file


def carry(near: int, far: int, loss: float, delay: tuple[float, float], seed: int) -> None:
    """Carry frames both ways until standard input closes."""
    draw, number = random.Random(seed), 0
    due: list[tuple[float, int, int, bytes]] = []
    while True:
        wait = max(0.0, due[0][0] - time.monotonic()) if due else None
        readable, _, _ = select.select([near, far, sys.stdin.fileno()], [], [], wait)
        if sys.stdin.fileno() in readable:
            return
        for source in readable:
            try:
                frame = os.read(source, FRAME)
            except OSError:  # the device is down
                continue
            if draw.random() >= loss:
                number += 1
                at = time.monotonic() + draw.uniform(*delay)
                heapq.heappush(due, (at, number, far if source == near else near, frame))
        while due and due[0][0] <= time.monotonic():
            _, _, target, frame = heapq.heappop(due)
            try:
                os.write(target, frame)
            except OSError:
                continue


def main() -> None:
    """Make the devices and carry frames."""
    parser = argparse.ArgumentParser()
    parser.add_argument("near")
    parser.add_argument("far")
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--delay", type=float, nargs=2, default=(0.0, 0.0))
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    near, far = tap(options.near), tap(options.far)
    print("up", flush=True)
    carry(near, far, options.loss, tuple(options.delay), options.seed)


if __name__ == "__main__":
    main()
