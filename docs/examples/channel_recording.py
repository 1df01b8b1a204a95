"""Write the recording of the channel from the states that ``./record`` prints."""

import sys

import numpy as np

NODES = [(i, 0) for i in (1, 4, 8, 14, 17, 20, 23, 26)]  # lower wall
NODES += [(i, 16) for i in (3, 9, 15, 21, 26)]  # upper wall
NODES += [(11, 8), (13, 4), (9, 5), (19, 6), (24, 8)]

states = np.loadtxt(sys.stdin).reshape(-1, 32, 17)
std = 0.01 * states.std()
clean = np.stack([states[:, i, j] for i, j in NODES], axis=1)
readings = clean + std * np.random.default_rng(21).standard_normal(clean.shape)
names = [f"S{k}" for k in range(len(NODES))]
table = np.column_stack([0.1 * np.arange(len(states)), readings])
header = ",".join(["time", *names])
np.savetxt("channel.csv", table, delimiter=",", header=header, comments="", fmt="%.8g")
with open("sensors.csv", "w") as file:
    print("name,field,x,y,std", file=file)
    for name, (i, j) in zip(names, NODES, strict=True):
        print(f"{name},c,{i * 0.125},{j / 16},{std:.5g}", file=file)
