"""Decodes the codec vectors of glint, written from docs/codecs.md alone. Needs numpy and zstandard.

    python3 codecs.py FOLDER

FOLDER holds index.json and the files it names. Each vector must decode to its .raw file, or be refused where the
index says so. Prints a line a vector; exit code 1 when one disagrees. The section numbers are those of the page.
"""

import json
import pathlib
import struct
import sys

import numpy as np
import zstandard

MISSING = (0, 65535)


class Damaged(Exception):
    """What the page calls an error."""


def unpack(packed, room):
    """The content of one zstd frame, at most `room` bytes, whatever it declares."""
    try:
        parameters = zstandard.get_frame_parameters(packed)
        if parameters.content_size not in (zstandard.CONTENTSIZE_UNKNOWN,) and parameters.content_size > room:
            raise Damaged("zstd frame is too long")
        decoder = zstandard.ZstdDecompressor().decompressobj()
        content = bytearray()
        # Pieces, so that a frame without a declared size cannot make more than a little too much.
        for start in range(0, len(packed), 256):
            content += decoder.decompress(packed[start : start + 256])
            if len(content) > room:
                raise Damaged("zstd frame is too long")
    except zstandard.ZstdError as error:
        raise Damaged(f"zstd: {error}") from error
    if not decoder.eof or decoder.unused_data:
        raise Damaged("zstd frame is cut or has bytes behind it")
    return bytes(content)


def read_table(data):
    """Section 2: (id, values)."""
    table_id, count = struct.unpack_from("<HH", data)
    values = np.frombuffer(data, "<u2", offset=4)
    if table_id == 0 or len(values) != count or not 1 <= count <= 2048:
        raise Damaged("table")
    if np.any(np.diff(values.astype(int)) <= 0) or values[0] == 0 or values[-1] == 65535:
        raise Damaged("table")
    return table_id, values


def signed16(value):
    value &= 0xFFFF
    return value - 0x10000 if value & 0x8000 else value


def decode_rvl(tokens, count):
    """Section 4."""
    nibbles = [half for byte in tokens for half in (byte & 15, byte >> 4)]
    place = 0

    def number(most):
        nonlocal place
        value = 0
        for group in range(most):
            if place == len(nibbles):
                raise Damaged("tokens end early")
            nibble = nibbles[place]
            place += 1
            value |= (nibble & 7) << (3 * group)
            if nibble < 8:
                return value
        raise Damaged("number is too long")

    codes = []
    previous = 0
    while len(codes) < count:
        zeros, others = number(10), number(10)
        if zeros == 0 and (others == 0 or codes):
            raise Damaged("empty run")
        if len(codes) + zeros + others > count:
            raise Damaged("run beyond the frame")
        codes += [0] * zeros
        for _ in range(others):
            zigzag = number(6)
            if zigzag > 65535:
                raise Damaged("difference")
            previous = (previous + ((zigzag >> 1) ^ -(zigzag & 1))) & 0xFFFF
            if previous == 0:
                raise Damaged("zero among others")
            codes.append(previous)
    if (place + 1) // 2 != len(tokens):
        raise Damaged("tokens go on")
    return codes


class RangeDecoder:
    """Section 5.2."""

    def __init__(self, stream):
        if len(stream) < 5 or stream[0] != 0:
            raise Damaged("range coder")
        self.stream = stream
        self.place = 5
        self.range = 0xFFFFFFFF
        self.code = int.from_bytes(stream[1:5], "big")

    def renormalise(self):
        while self.range < 1 << 24:
            if self.place == len(self.stream):
                raise Damaged("range coder ends early")
            self.range = (self.range << 8) & 0xFFFFFFFF
            self.code = ((self.code << 8) | self.stream[self.place]) & 0xFFFFFFFF
            self.place += 1

    def decision(self, table, index):
        p = table[index]
        bound = (self.range >> 15) * p
        if self.code < bound:
            self.range = bound
            table[index] = p + ((32768 - p) >> 5)
            result = 0
        else:
            self.code -= bound
            self.range -= bound
            table[index] = p - (p >> 5)
            result = 1
        self.renormalise()
        return result

    def even(self):
        self.range >>= 1
        result = int(self.code >= self.range)
        if result:
            self.code -= self.range
        self.renormalise()
        return result


def decode_residual(coder, table, base):
    """Section 5.1, the residual: the difference d."""
    if not coder.decision(table, base):
        return 0
    negative = coder.decision(table, base + 1)
    magnitude = 13
    for k in range(1, 13):
        if not coder.decision(table, base + 1 + k):
            magnitude = k
            break
    if magnitude == 13:
        bits = 0
        while not coder.even():
            bits += 1
            if bits == 16:
                raise Damaged("difference")
        value = 1
        for _ in range(bits):
            value = value << 1 | coder.even()
        magnitude = 12 + value
        if magnitude > 32768:
            raise Damaged("difference")
    return -magnitude if negative else magnitude


def decode_dense(stream, width, height):
    """Section 5.1."""
    coder = RangeDecoder(stream)
    presence = [16384] * 16
    residual = [16384] * (1000 * 14)
    codes = np.zeros((height, width), dtype=int)
    last = 0
    for j in range(height):
        for i in range(width):
            left = int(codes[j, i - 1]) if i else 0
            up = int(codes[j - 1, i]) if j else 0
            up_left = int(codes[j - 1, i - 1]) if i and j else 0
            up_right = int(codes[j - 1, i + 1]) if j and i + 1 < width else 0
            number = (left != 0) + 2 * (up != 0) + 4 * (up_left != 0) + 8 * (up_right != 0)
            if not coder.decision(presence, number):
                continue
            prediction = left or up or up_right or last
            context = 0
            for neighbour in (up, up_left, up_right):
                kind = 9 if neighbour == 0 else max(-4, min(4, neighbour - prediction)) + 4
                context = context * 10 + kind
            last = (prediction + decode_residual(coder, residual, 14 * context)) & 0xFFFF
            if last == 0:
                raise Damaged("code 0 that is present")
            codes[j, i] = last
    if coder.place != len(stream):
        raise Damaged("range coder goes on")
    return codes.ravel()


def decode_depth(payload, width, height, table):
    """Section 3: n samples."""
    if len(payload) < 3:
        raise Damaged("cut")
    codec, table_id = struct.unpack_from("<BH", payload)
    body = payload[3:]
    count = width * height
    if codec == 0:
        if table_id or len(body) != 2 * count:
            raise Damaged("raw")
        return np.frombuffer(body, "<u2")
    if codec == 1:
        codes = decode_rvl(unpack(body, 3 * count + count // 64 + 16), count)
    elif codec == 2:
        codes = decode_dense(body, width, height)
    else:
        raise Damaged("unknown codec")
    codes = np.asarray(codes, dtype=int)
    if table_id == 0:
        return codes.astype("<u2")
    if table is None or table[0] != table_id:
        raise Damaged("another table")
    values = table[1]
    valid = ~np.isin(codes, MISSING)
    if np.any(codes[valid] > len(values)):
        raise Damaged("code beyond the table")
    samples = codes.copy()
    samples[valid] = values[codes[valid] - 1]
    return samples.astype("<u2")


def planes_of(pixel_format, width, height):
    """Section 6: views of a raw frame in the order of the residuals, and whether green is subtracted."""
    if pixel_format == "bayer-grbg":
        frame = np.zeros((height, width), dtype=np.uint8)
        return frame, [(frame[y::2, x::2], False) for y in (0, 1) for x in (0, 1)]
    if pixel_format in ("uyvy", "yuyv"):
        frame = np.zeros((height, 2 * width), dtype=np.uint8)
        luma, blue, red = (1, 0, 2) if pixel_format == "uyvy" else (0, 1, 3)
        return frame, [(frame[:, luma::2], False), (frame[:, blue::4], False), (frame[:, red::4], False)]
    if pixel_format == "rgb8":
        frame = np.zeros((height, 3 * width), dtype=np.uint8)
        return frame, [(frame[:, 1::3], False), (frame[:, 0::3], True), (frame[:, 2::3], True)]
    if pixel_format == "infrared10":
        frame = np.zeros((height, 2 * width), dtype=np.uint8)
        return frame, [(frame[:, 0::2], False), (frame[:, 1::2], False)]
    raise ValueError(pixel_format)


def median_edge(a, b, c):
    if c >= max(a, b):
        return min(a, b)
    if c <= min(a, b):
        return max(a, b)
    return a + b - c


def decode_color(payload, pixel_format, width, height):
    """Section 6: the raw frame."""
    if not payload:
        raise Damaged("cut")
    frame, planes = planes_of(pixel_format, width, height)
    body = payload[1:]
    if payload[0] == 0:
        if len(body) != frame.size:
            raise Damaged("raw")
        return np.frombuffer(body, np.uint8)
    if payload[0] != 1:
        raise Damaged("unknown codec")
    residuals = unpack(body, frame.size)
    if len(residuals) != frame.size:
        raise Damaged("residuals are cut")
    place = 0
    green = None
    for plane, is_less_green in planes:
        rows, columns = plane.shape
        coded = np.zeros((rows, columns), dtype=int)
        for j in range(rows):
            for i in range(columns):
                b = int(coded[j - 1, i]) if j else 0
                a = int(coded[j, i - 1]) if i else b
                c = (int(coded[j - 1, i - 1]) if j else 0) if i else b
                coded[j, i] = (median_edge(a, b, c) + residuals[place]) & 255
                place += 1
        plane[:] = (coded + green if is_less_green else coded) & 255
        green = coded if green is None else green
    return frame.ravel()


def check(folder, vector):
    """None when the vector decodes as it should, else what is wrong."""
    payload = (folder / f"{vector['name']}.payload").read_bytes()
    width, height = vector["width"], vector["height"]
    table = vector.get("table")
    table = read_table((folder / table).read_bytes()) if table else None
    try:
        if vector["format"] == "depth":
            decoded = decode_depth(payload, width, height, table)
        else:
            decoded = decode_color(payload, vector["format"], width, height)
    except Damaged as reason:
        return None if vector["refused"] else f"refused: {reason}"
    if vector["refused"]:
        return "should be refused"
    expected = (folder / f"{vector['name']}.raw").read_bytes()
    return None if decoded.tobytes() == expected else "decodes to something else"


def main():
    folder = pathlib.Path(sys.argv[1])
    vectors = json.loads((folder / "index.json").read_text())
    wrong = 0
    for vector in vectors:
        verdict = check(folder, vector)
        wrong += verdict is not None
        print(f"{vector['name']}: {verdict or 'agrees'}")
    print(f"{len(vectors) - wrong} of {len(vectors)} vectors agree")
    return 1 if wrong or not vectors else 0


if __name__ == "__main__":
    sys.exit(main())
