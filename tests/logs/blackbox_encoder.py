"""A Blackbox recorder for tests: writes logs and remembers the value of every field.

Written from the specification, value by value in plain Python, and sharing no line with the
decoder: all encodings of data versions 1 and 2, all predictors, all kinds of frames.
"""

import random
from dataclasses import dataclass, field

PRODUCT = "Product:Blackbox flight data recorder by Nicholas Sherlock"

# name, signed, predictor and encoding in I frames, predictor and encoding in P frames
MAIN_FIELDS = [
    ("loopIteration", 0, 0, 1, 6, 9),
    ("time", 0, 0, 1, 2, 0),
    *[(f"rcCommand[{i}]", 1, 0, 0, 1, 8) for i in range(4)],
    *[(f"axisI[{i}]", 1, 0, 0, 1, 7) for i in range(3)],
    *[(f"axisS[{i}]", 1, 0, 10, 1, 10) for i in range(3)],
    ("vbatLatest", 0, 9, 3, 1, 6),
    ("amperageLatest", 1, 0, 0, 1, 6),
    *[(f"debug[{i}]", 1, 0, 6, 1, 6) for i in range(9)],  # 11 in a row: groups of 8 and 3
    *[(f"gyroADC[{i}]", 1, 0, 0, 3, 0) for i in range(3)],
    ("rssi", 1, 0, 6, 1, 6),  # alone: no tag byte
    *[(f"accSmooth[{i}]", 1, 0, 0, 3, 0) for i in range(3)],
    ("motor[0]", 0, 11, 1, 3, 0),
    *[(f"motor[{i}]", 0, 5, 0, 3, 0) for i in range(1, 4)],
    ("servo[5]", 0, 8, 0, 8, 0),
    ("tail", 1, 4, 0, 5, 1),
    ("crc", 0, 0, 1, 0, 1),
    ("negated", 1, 0, 3, 1, 3),
    *[(f"wind[{i}]", 1, 0, 8, 2, 8) for i in range(4)],
]
# name, signed, predictor, encoding
SLOW_FIELDS = [
    ("flightModeFlags", 0, 0, 1),
    ("stateFlags", 0, 0, 1),
    ("failsafePhase", 0, 0, 7),
    ("rxSignalReceived", 0, 0, 7),
    ("rxFlightChannelsValid", 0, 0, 7),
]
GPS_FIELDS = [
    ("time", 0, 10, 1),
    ("GPS_numSat", 0, 0, 1),
    ("GPS_coord[0]", 1, 7, 0),
    ("GPS_coord[1]", 1, 7, 0),
    ("GPS_altitude", 1, 0, 0),
]
HOME_FIELDS = [("GPS_home[0]", 1, 0, 0), ("GPS_home[1]", 1, 0, 0)]

ENTRIES = {
    "Firmware revision": "Betaflight 4.5.0 (norevision) TEST",
    "Craft name": "Prüfstand",
    "minthrottle": "1070",
    "maxthrottle": "2000",
    "gyro_scale": "0x3f800000",
    "motorOutput": "158,2047",
    "acc_1G": "2048",
    "vbatref": "1600",
    "looptime": "125",
    "motor_poles": "14",
    "gyro_lpf1_static_hz": "250",
}


def unsigned_vb(value: int) -> bytes:
    value &= 0xFFFFFFFF
    out = bytearray()
    while value > 127:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def signed_vb(value: int) -> bytes:
    return unsigned_vb(((value << 1) ^ (value >> 31)) & 0xFFFFFFFF)


def fits(value: int, bits: int) -> bool:
    return -(1 << (bits - 1)) <= value < 1 << (bits - 1)


def pack_bits(parts: list[tuple[int, int]]) -> bytes:
    """Big-endian bit string of (value, bits), filled with zeros to whole bytes."""
    text = "".join(format(value & ((1 << bits) - 1), f"0{bits}b") for value, bits in parts)
    text += "0" * (-len(text) % 8)
    return bytes(int(text[i : i + 8], 2) for i in range(0, len(text), 8))


def tag2_3(values: list[int], widths: list[tuple[int, int, int]]) -> bytes:
    for selector, bits in enumerate(widths):
        if all(fits(v, b) for v, b in zip(values, bits, strict=True)):
            parts = [(selector, 2), *zip(values, bits, strict=True)]
            if bits == (4, 4, 4):  # two spare bits after the tag
                parts.insert(1, (0, 2))
            elif bits == (6, 6, 6):  # and before the second and the third value
                parts[2:2] = [(0, 2)]
                parts[4:4] = [(0, 2)]
            return pack_bits(parts)
    sizes = [next(n for n in (1, 2, 3, 4) if fits(v, 8 * n)) for v in values]
    tag = 0xC0 | sum((n - 1) << (2 * i) for i, n in enumerate(sizes))
    body = b"".join(
        v.to_bytes(n, "little", signed=True) for v, n in zip(values, sizes, strict=True)
    )
    return bytes([tag]) + body


def tag2_3s32(values: list[int]) -> bytes:
    return tag2_3(values, [(2, 2, 2), (4, 4, 4), (6, 6, 6)])


def tag2_3svariable(values: list[int]) -> bytes:
    return tag2_3(values, [(2, 2, 2), (5, 5, 4), (8, 7, 7)])


def tag8_4s16(values: list[int], version: int) -> bytes:
    if version == 1:
        return tag8_4s16_v1(values)
    widths = [next(b for b in (0, 4, 8, 16) if v == 0 or (b and fits(v, b))) for v in values]
    tag = sum([0, 4, 8, 16].index(b) << (2 * i) for i, b in enumerate(widths))
    return bytes([tag]) + pack_bits([(v, b) for v, b in zip(values, widths, strict=True) if b])


def tag8_4s16_v1(values: list[int]) -> bytes:
    tags, body, i = [0, 0, 0, 0], b"", 0
    while i < 4:
        value = values[i]
        if value == 0:
            i += 1
        elif i < 3 and fits(value, 4) and fits(values[i + 1], 4):
            tags[i] = tags[i + 1] = 1
            body += bytes([(value & 15) | (values[i + 1] & 15) << 4])
            i += 2
        else:
            size = 1 if fits(value, 8) else 2
            tags[i] = 1 + size
            body += value.to_bytes(size, "little", signed=True)
            i += 1
    return bytes([sum(tag << (2 * i) for i, tag in enumerate(tags))]) + body


def tag8_8svb(values: list[int]) -> bytes:
    if len(values) == 1:
        return signed_vb(values[0])
    tag = sum(1 << i for i, value in enumerate(values) if value)
    return bytes([tag]) + b"".join(signed_vb(value) for value in values if value)


def encode_fields(deltas: list[int], encodings: list[int], version: int) -> bytes:
    out, i = b"", 0
    while i < len(deltas):
        encoding = encodings[i]
        longest = {6: 8, 7: 3, 8: 4, 10: 3}.get(encoding, 1)
        count = 1
        while count < longest and i + count < len(deltas) and encodings[i + count] == encoding:
            count += 1
        group = deltas[i : i + count]
        match encoding:
            case 0:
                out += signed_vb(group[0])
            case 1:
                out += unsigned_vb(group[0])
            case 3:
                out += unsigned_vb(-group[0] & 0x3FFF)
            case 6:
                out += tag8_8svb(group)
            case 7:
                out += tag2_3s32(group)
            case 8:
                out += tag8_4s16(group, version)
            case 10:
                out += tag2_3svariable(group)
            case _:
                pass
        i += count
    return out


def wrap32(value: int, signed: int) -> int:
    value &= 0xFFFFFFFF
    return value - (1 << 32) if signed and value >= 1 << 31 else value


def random_delta(rng: random.Random, encoding: int) -> int:
    """A difference that the encoding can hold; small ones are as likely as large ones."""
    widest = {3: 13, 8: 15, 9: 0}.get(encoding, 31)
    bits = rng.randint(0, widest)
    value = rng.randint(-(1 << bits), (1 << bits) - 1) if bits else 0
    return abs(value) if encoding == 1 else (-value if encoding == 3 else value)


@dataclass
class Recorder:
    """Writes one log; the fields of each kind of frame end up in the lists."""

    version: int = 2
    i_interval: int = 32
    p_interval: str = "1/2"
    entries: dict[str, str] = field(default_factory=lambda: dict(ENTRIES))
    main_fields: list[tuple[str, int, int, int, int, int]] = field(
        default_factory=lambda: list(MAIN_FIELDS)
    )
    main: list[list[int]] = field(default_factory=list)
    intra: list[bool] = field(default_factory=list)
    slow: list[list[int]] = field(default_factory=list)
    gps: list[list[int]] = field(default_factory=list)
    home: list[list[int]] = field(default_factory=list)
    events: list[tuple[int, tuple[int, ...]]] = field(default_factory=list)
    body: bytes = b""
    offsets: list[int] = field(default_factory=list)
    """Of the letter of each main frame in `body`."""

    def header(self) -> bytes:
        names, signed, ip, ie, pp, pe = zip(*self.main_fields, strict=True)
        lines = [PRODUCT, f"Data version:{self.version}"]
        for letter, kind, values in [
            ("I", "name", names),
            ("I", "signed", signed),
            ("I", "predictor", ip),
            ("I", "encoding", ie),
            ("P", "predictor", pp),
            ("P", "encoding", pe),
        ]:
            lines.append(f"Field {letter} {kind}:" + ",".join(map(str, values)))
        for letter, fields in (("S", SLOW_FIELDS), ("G", GPS_FIELDS), ("H", HOME_FIELDS)):
            columns = zip(*fields, strict=True)
            for kind, values in zip(
                ("name", "signed", "predictor", "encoding"), columns, strict=True
            ):
                lines.append(f"Field {letter} {kind}:" + ",".join(map(str, values)))
        lines += [f"I interval:{self.i_interval}", f"P interval:{self.p_interval}"]
        lines += [f"{name}:{value}" for name, value in self.entries.items()]
        return "".join(f"H {line}\n" for line in lines).encode()

    @property
    def data(self) -> bytes:
        return self.header() + self.body

    def _constant(self, predictor: int) -> int:
        return {
            4: int(self.entries.get("minthrottle", "0")),
            8: 1500,
            9: int(self.entries.get("vbatref", "0")),
            11: int(self.entries.get("motorOutput", "0,0").split(",")[0]),
        }.get(predictor, 0)

    def _predict(self, predictor: int, i: int, frame: list[int]) -> int:
        if predictor == 5:
            return frame[[f[0] for f in self.main_fields].index("motor[0]")]
        if predictor in (1, 2, 3):
            one = self.main[-1][i]
            two = one if self.intra[-1] else self.main[-2][i]
            return {1: one, 2: 2 * one - two, 3: int((one + two) / 2)}[predictor]
        return self._constant(predictor)

    def record(self, deltas: list[int], *, is_intra: bool) -> list[int]:
        """Write a main frame of these differences; `time` is absolute, loopIteration too."""
        frame: list[int] = []
        written: list[int] = []
        encodings = []
        for i, (name, signed, ip, ie, pp, pe) in enumerate(self.main_fields):
            predictor, encoding = (ip, ie) if is_intra else (pp, pe)
            encodings.append(encoding)
            if name in ("loopIteration", "time"):
                guess = self._predict(predictor, i, frame) if name == "time" else 0
                frame.append(deltas[i] & 0xFFFFFFFF)
                written.append(wrap32(deltas[i] - guess, 1))
                continue
            guess = self._predict(predictor, i, frame)
            frame.append(wrap32(deltas[i] + guess, signed))
            written.append(deltas[i])
        self.offsets.append(len(self.body))
        self.body += (b"I" if is_intra else b"P") + encode_fields(written, encodings, self.version)
        self.main.append(frame)
        self.intra.append(is_intra)
        return frame

    def record_other(self, letter: str, deltas: list[int]) -> None:
        fields = {"S": SLOW_FIELDS, "G": GPS_FIELDS, "H": HOME_FIELDS}[letter]
        home = self.home[-1] if self.home else [0, 0]
        frame = []
        for delta, (name, signed, predictor, _) in zip(deltas, fields, strict=True):
            guess = self._constant(predictor)
            if predictor == 7:
                guess = home[int(name[-2])]
            elif predictor == 10:
                guess = self.main[-1][1] if self.main else 0
            frame.append(wrap32(delta + guess, signed))
        self.body += letter.encode()
        self.body += encode_fields(deltas, [f[3] for f in fields], self.version)
        {"S": self.slow, "G": self.gps, "H": self.home}[letter].append(frame)

    def event(self, kind: int, payload: bytes, values: tuple[int, ...]) -> None:
        self.body += b"E" + bytes([kind]) + payload
        self.events.append((kind, values))

    def end(self) -> None:
        self.event(255, b"End of log\x00", ())


def is_logged(iteration: int, recorder: Recorder) -> bool:
    numerator, slash, denominator = recorder.p_interval.partition("/")
    num, den = (int(numerator), int(denominator)) if slash else (1, int(numerator))
    den = den or recorder.i_interval  # 0: I frames only
    return (iteration % recorder.i_interval + num - 1) % den < num


EVENTS = [
    (0, unsigned_vb(123456), (123456,)),
    (13, bytes([5]) + signed_vb(-300), (5, -300)),
    (13, bytes([0x85]) + bytes([0, 0, 128, 63]), (0x85, 0x3F800000)),
    (15, unsigned_vb(4), (4,)),
    (30, unsigned_vb(7) + unsigned_vb(1 << 31), (7, 1 << 31)),
    (40, bytes([1, 0, 0, 128, 63]), (1 | 0x3F800000 << 8,)),
    (10, bytes([1, 2, 3, 4, 5]), (0x0504030201,)),
    (20, bytes([2]) + signed_vb(-5) + b"\x07\x00", (2, -5, 7)),
]


def record_random(
    seed: int, iterations: int, *, version: int = 2, p_interval: str = "1/2", quiet: bool = False
) -> Recorder:
    """A log of random frames; `quiet`: small differences, so that values stay plausible."""
    rng = random.Random(seed)
    recorder = Recorder(version=version, p_interval=p_interval)
    time = rng.randrange(1 << 31)
    for iteration in range(iterations):
        if not is_logged(iteration, recorder):
            continue
        time += rng.randint(1, 4000)
        is_intra = iteration % recorder.i_interval == 0
        column = 3 if is_intra else 5
        deltas = [random_delta(rng, f[column]) for f in recorder.main_fields]
        if quiet:
            deltas = [
                d % 7 - 3 if f[column] != 1 else abs(d) % 7
                for d, f in zip(deltas, recorder.main_fields, strict=True)
            ]
        deltas[0], deltas[1] = iteration, time
        recorder.record(deltas, is_intra=is_intra)
        if rng.random() < 0.2:
            letter = rng.choice("SGH")
            fields = {"S": SLOW_FIELDS, "G": GPS_FIELDS, "H": HOME_FIELDS}[letter]
            recorder.record_other(letter, [random_delta(rng, f[3]) for f in fields])
        if rng.random() < 0.1:
            recorder.event(*rng.choice(EVENTS))
    return recorder
