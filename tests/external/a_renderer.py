"""A renderer of another house: `python a_renderer.py MODE SPP SEED WIDTH HEIGHT IMAGE`; grey with noise, as PFM.

Standard library only, so that it starts in no time. MODE says what goes wrong.
"""

import os
import random
import signal
import struct
import sys
import time

MEAN, NOISE = 0.5, 0.2


def main():
    mode, spp, seed, width, height, image = sys.argv[1], *map(int, sys.argv[2:6]), sys.argv[6]
    print(f"threads {os.environ.get('OMP_NUM_THREADS')}, a scene of {os.path.getsize(os.environ['A_SCENE'])} bytes")
    if mode == "crash":
        print("the tree fell over\n")
        sys.exit(3)
    if mode == "signal":
        os.kill(os.getpid(), signal.SIGSEGV)
    if mode == "hang":
        time.sleep(600)
    if mode == "silent":
        return
    if mode == "size":
        width += 1
    draw = random.Random(seed)
    sigma = NOISE / spp**0.5
    values = [draw.gauss(MEAN, sigma) for _ in range(3 * width * height)]
    if mode == "nan":
        values[4] = float("nan")
    data = f"PF\n{width} {height}\n-1.0\n".encode() + struct.pack(f"<{len(values)}f", *values)
    with open(image, "wb") as file:
        file.write(b"PF or so" if mode == "garbage" else data)
    if mode != "wordless":
        print(f"progress: took 9.0s\nrendering took {1000 * spp}ms")


main()
