"""A simulated flight as a Blackbox log, for tests of the command line."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "logs"))

import blackbox_encoder as encoder


def blackbox_of(columns: dict[str, np.ndarray], *, motors: bool = True) -> bytes:
    """Return a log of I frames: gyro, accelerometer, and rotor speeds if wanted."""
    gyro = np.degrees(np.stack([columns[f"gyro_{a}"] for a in "xyz"], axis=1))
    accel = np.stack([columns[f"accel_{a}"] for a in "xyz"], axis=1) / 9.80665 * 2048
    fields = {f"gyroADC[{i}]": gyro[:, i] for i in range(3)}
    fields |= {f"accSmooth[{i}]": accel[:, i] for i in range(3)}
    if motors:
        fields |= {f"eRPM[{i}]": columns[f"rotor_{i + 1}"] * 0.668 for i in range(4)}
    rows = np.rint(np.stack(list(fields.values()), axis=1)).astype(int).tolist()
    recorder = encoder.Recorder(i_interval=1)
    recorder.main_fields = [*encoder.MAIN_FIELDS[:2], *[(name, 1, 0, 0, 0, 0) for name in fields]]
    for i, (time, row) in enumerate(zip(columns["time"], rows, strict=True)):
        recorder.record([i, round(1e6 * time) + 500, *row], is_intra=True)
    recorder.end()
    return bytes(recorder.data)
