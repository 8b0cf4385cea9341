"""Reads `.glint` recordings, written from docs/sequence-format.md and docs/codecs.md alone. Needs numpy and zstandard.

    python3 glint_reader.py FILE... | FOLDER

For each file a JSON object is printed: streams, frames with their times and the CRC-32 (of zlib) of their samples,
everything else that the file holds, and what is damaged. With a folder that holds index.json and the files it names,
each file, edited as the index says, must hold what the index says; exit code 1 when one does not. The section numbers
are those of the page.
"""

import importlib.util
import json
import pathlib
import struct
import sys
import zlib

# By its path: `codecs` is also a module of Python.
of_page = importlib.util.spec_from_file_location("glint_codecs", pathlib.Path(__file__).with_name("codecs.py"))
codecs = importlib.util.module_from_spec(of_page)
of_page.loader.exec_module(codecs)

PAGE, HEADER, RECORD = 4096, 128, 24
FIRST_LINE = b"glint recording, version 1\n" + bytes(5)
DESCRIPTION, TABLE, FRAME, GAP, EVENT, POSE_SET, POSES, GRAVITY, HISTOGRAM, NOTE, SPLIT, INDEX, END = range(1, 14)
MUST_UNDERSTAND = 0x8000
CAUSES = ("", "usb-short", "packet-loss", "corrupt", "unmatched", "pool-empty", "ring-full", "disk-late", "unplug",
          "restart", "source", "disk-full", "damaged", "disk-error", "cut")


def castagnoli_table():
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (0x82F63B78 if byte & 1 else 0)
        yield byte


CASTAGNOLI = tuple(castagnoli_table())


def crc32c(*pieces):
    """Section 2."""
    crc = 0xFFFFFFFF
    for piece in pieces:
        for byte in piece:
            crc = crc >> 8 ^ CASTAGNOLI[(crc ^ byte) & 255]
    return crc ^ 0xFFFFFFFF


class Refused(Exception):
    """The page says that a reader refuses this file."""


class Record:
    """Section 5: one record whose checksum is right."""

    def __init__(self, kind, stream, sequence, payload, end):
        self.kind, self.stream, self.sequence, self.payload, self.end = kind, stream, sequence, payload, end


class Chunk:
    """Section 4: a chunk header that is valid."""

    def __init__(self, data, offset):
        (self.number, self.size, self.count, self.index, self.first) = struct.unpack_from("<QQIIQ", data, offset + 24)
        self.offset, self.crc = offset, struct.unpack_from("<I", data, offset + 56)[0]
        self.records = offset + HEADER
        self.end = self.records + self.size
        self.next = (self.end + PAGE - 1) // PAGE * PAGE

    def mark_is_valid(self, data):
        mark = data[self.offset + 64 : self.offset + 128]
        head = data[self.offset + 56 : self.offset + 64]
        same = mark[:8] == b"glcommit" and mark[8:16] == struct.pack("<Q", self.number) and mark[16:24] == head
        return same and len(mark) == 64 and crc32c(mark[:60]) == struct.unpack("<I", mark[60:])[0]


class Reader:
    """Section 7: all records of a file in order, and what is damaged."""

    def __init__(self, data):
        self.data, self.damages, self.records, self.lost, self.tail = data, [], [], [], 0
        head = data[:64]
        if head[:32] != FIRST_LINE:
            raise Refused("not a recording of version 1")
        if len(head) < 64 or crc32c(head[:60]) != struct.unpack_from("<I", head, 60)[0]:
            raise Refused("the file header is damaged")
        self.file_id = head[40:56]
        self.read_chunks()

    def chunk_at(self, offset, least_number):
        """The chunk that begins at an offset, when its header is valid and its number fits."""
        head = self.data[offset : offset + 64]
        if len(self.data) < offset + HEADER or head[:8] != b"\x89glchunk" or head[8:24] != self.file_id:
            return None
        chunk = Chunk(self.data, offset)
        fits = chunk.size % 8 == 0 and chunk.size <= 1 << 31 and chunk.index >= HEADER and chunk.number >= least_number
        return chunk if fits and crc32c(head[:60]) == struct.unpack_from("<I", head, 60)[0] else None

    def record_at(self, offset, end):
        """The record at an offset, when it is valid and lies before `end`."""
        if offset + RECORD > end or self.data[offset : offset + 4] != b"gRec":
            return None
        kind, stream, length, crc, sequence = struct.unpack_from("<HHIIQ", self.data, offset + 4)
        behind = offset + RECORD + length
        if length > 1 << 30 or behind > end:
            return None
        payload = self.data[offset + RECORD : behind]
        covered = (self.file_id, self.data[offset : offset + 12], self.data[offset + 16 : offset + 24], payload)
        return Record(kind, stream, sequence, payload, (behind + 7) // 8 * 8) if crc32c(*covered) == crc else None

    def walk(self, place, end):
        end = min(end, len(self.data))
        while place < end:
            record = self.record_at(place, end)
            if record is not None:
                yield record
            place = place + 8 if record is None else record.end

    def read_chunks(self):
        place, number = PAGE, 0
        while place < len(self.data):
            chunk = self.chunk_at(place, number)
            if chunk is not None and self.read_chunk(chunk):
                place, number = chunk.next, chunk.number + 1
                continue
            later = (at for at in range(place + PAGE, len(self.data), PAGE) if self.chunk_at(at, number))
            following = next(later, None)
            if following is None and self.is_marked(place, number):
                following = len(self.data)
            if following is None:
                if any(self.data[place:]):
                    self.damages.append("tail")
                    self.tail = sum(record.kind != INDEX for record in self.walk(place, len(self.data)))
                return
            self.damages.append("header")
            self.records += self.walk(place, following)
            place = following

    def is_marked(self, place, least_number):
        """Section 7, 3: whether a commit mark is valid by itself."""
        mark = self.data[place + 64 : place + HEADER]
        if len(mark) < 64 or mark[:8] != b"glcommit" or struct.unpack_from("<Q", mark, 8)[0] < least_number:
            return False
        return crc32c(mark[:60]) == struct.unpack("<I", mark[60:])[0]

    def read_chunk(self, chunk):
        """Whether the chunk is sealed; its records are taken then."""
        if chunk.end > len(self.data):
            return False
        is_marked = chunk.mark_is_valid(self.data)
        is_whole = crc32c(self.data[chunk.records : chunk.end]) == chunk.crc
        if not is_marked and not is_whole:
            return False
        if chunk.count == 0:
            return True
        if not is_marked:
            self.damages.append("commit-mark")
        index = self.record_at(chunk.offset + chunk.index, chunk.end)
        entries = self.entries_of(index, chunk)
        if entries is None:
            self.damages.append("index")
            self.records += self.walk(chunk.records, chunk.end)
            return True
        lost_before = len(self.lost)
        for offset, _, kind, stream, _, number, _, _ in entries:
            record = self.record_at(chunk.offset + offset, chunk.end)
            if record is None:
                self.damages.append("record")
                self.lost.append(f"{stream} {number}" if kind == FRAME else f"kind {kind}")
            else:
                self.records.append(record)
        # Behind the index stands `end`, if anything.
        behind = list(self.walk(index.end, chunk.end))
        self.records += behind
        if not is_whole and not behind and chunk.count == len(entries) + 2:
            self.damages.append("record")
            self.lost.append(f"kind {END}")
        elif not is_whole and len(self.lost) == lost_before:
            self.damages.append("padding")
        return True

    @staticmethod
    def entries_of(index, chunk):
        """Section 6.12; None when the index is damaged."""
        if index is None or index.kind != INDEX or len(index.payload) % 40:
            return None
        entries = list(struct.iter_unpack("<IIHHIQqQ", index.payload))
        free_from = HEADER
        for offset, length, *_ in entries:
            if offset < free_from or offset % 8:
                return None
            free_from = (offset + RECORD + length + 7) // 8 * 8
        return entries if free_from <= chunk.index else None


def poses_of(records):
    """Section 6.7, an entry a line: set, frame, map, state, axes, quaternion and translation, covariance."""
    poses = {}
    for record in records:
        name = struct.unpack_from("<H", record.payload)[0]
        for place in range(8, len(record.payload), 160):
            entry = struct.unpack_from("<QIBBH7d21f", record.payload, place)
            number, flags = entry[0], entry[4]
            words = [str(word) for word in (name, *entry[:4])] + [f"{word:.9f}" for word in entry[5:12]]
            words += [f"{word:.6f}" for word in entry[12:]] if flags & 1 else []
            poses[name, number] = " ".join(words)
    return [poses[key] for key in sorted(poses)]


def samples_of(frame, stream, tables):
    """Section 6.3: the bytes of the samples of a frame, or None when they cannot be decoded."""
    image = frame.payload[48:]
    try:
        if stream["kind"] == "depth":
            table = tables.get((frame.stream, struct.unpack_from("<H", image, 1)[0]))
            return codecs.decode_depth(image, stream["width"], stream["height"], table).tobytes()
        if stream["format"] == "jpeg":
            return image
        return codecs.decode_color(image, stream["format"], stream["width"], stream["height"]).tobytes()
    except (codecs.Damaged, struct.error):
        return None


def frames_of(records, streams, tables, lost):
    """Section 6.3, a frame a line: number, counter, times, flags, CRC-32 of the samples; of each number the first."""
    frames = {stream: {} for stream in streams}
    for record in records:
        number, ticks, device, first, last, flags = struct.unpack_from("<QQqqqI", record.payload)
        if record.stream not in streams or number in frames[record.stream]:
            continue
        samples = samples_of(record, streams[record.stream], tables)
        if samples is None:
            lost.append(f"{record.stream} {number}")
        else:
            line = f"{number} {ticks} {device} {first} {last} {flags} {zlib.crc32(samples):08x}"
            frames[record.stream][number] = line
    return {str(stream): [lines[number] for number in sorted(lines)] for stream, lines in frames.items()}


def gap_of(record):
    number, count, before, after, cause = struct.unpack_from("<QQqqH", record.payload)
    return f"{record.stream} {number} {count} {before} {after} {CAUSES[cause]} {record.payload[40:].decode()}"


def gravity_of(record):
    number, x, y, z, sigma = struct.unpack_from("<Q3df", record.payload)
    return f"{record.stream} {number} {x:.6f} {y:.6f} {z:.6f} {sigma:.6f}"


def nanos_of(record):
    return struct.unpack_from("<q", record.payload)[0]


def read(data):
    """All that a recording holds."""
    reader = Reader(data)
    unknown = sorted(record.kind for record in reader.records if record.kind not in range(1, 14))
    if any(kind & MUST_UNDERSTAND for kind in unknown):
        raise Refused("holds a kind of record that must be understood")
    of = {kind: [record for record in reader.records if record.kind == kind] for kind in range(1, 14)}
    if not of[DESCRIPTION]:
        raise Refused("no description")
    description = json.loads(of[DESCRIPTION][0].payload)
    streams = {stream["id"]: stream for stream in description["streams"]}
    tables = {}
    for record in of[TABLE]:
        table = codecs.read_table(record.payload)
        tables[record.stream, table[0]] = table
    return {
        "streams": [f"{s['id']} {s['kind']} {s['format']} {s['width']}x{s['height']}" for s in streams.values()],
        "part": description.get("part"),
        "tables": [f"{stream} {name} {len(table[1])}" for (stream, name), table in sorted(tables.items())],
        "frames": frames_of(of[FRAME], streams, tables, reader.lost),
        "gaps": sorted(gap_of(record) for record in of[GAP]),
        "events": [[record.stream, nanos_of(record), json.loads(record.payload[8:])] for record in of[EVENT]],
        "pose_sets": [json.loads(payload) for payload in dict.fromkeys(record.payload for record in of[POSE_SET])],
        "poses": poses_of(of[POSES]),
        "gravity": [gravity_of(record) for record in of[GRAVITY]],
        "histograms": [json.loads(record.payload) for record in of[HISTOGRAM]],
        "notes": [[nanos_of(record), record.payload[8:].decode()] for record in of[NOTE]],
        "split": json.loads(of[SPLIT][-1].payload) if of[SPLIT] else None,
        "end": json.loads(of[END][-1].payload) if of[END] else None,
        "unknown": unknown,
        "lost": sorted(reader.lost),
        "damages": sorted(reader.damages),
        "tail": reader.tail,
    }


def edited(folder, name, edits):
    """A file with the edits of a vector: a cut, zeros, bytes of a file, bytes that are put or xored."""
    data = bytearray((folder / name).read_bytes())
    for edit in edits:
        at = edit.get("at", 0)
        if "cut" in edit:
            del data[edit["cut"] :]
        elif "zeros" in edit:
            data[at : at + edit["zeros"]] = bytes(edit["zeros"])
        elif "file" in edit:
            start = edit["from"]
            piece = (folder / edit["file"]).read_bytes()[start : start + edit["bytes"]]
            data[at : at + len(piece)] = piece
        elif "put" in edit:
            put = bytes.fromhex(edit["put"])
            data[at : at + len(put)] = put
        else:
            for place, byte in enumerate(bytes.fromhex(edit["xor"])):
                data[at + place] ^= byte
    return bytes(data)


def check(folder, vector):
    """None when a vector is read as its entry of index.json says, else what differs."""
    try:
        found = read(edited(folder, vector["file"], vector["edits"]))
    except Refused as reason:
        return None if vector["refused"] else f"refused: {reason}"
    if vector["refused"]:
        return "should be refused"
    wrong = [f"{key}: {found[key]}, expected {value}" for key, value in vector["holds"].items() if found[key] != value]
    return "; ".join(wrong) or None


def main():
    paths = [pathlib.Path(argument) for argument in sys.argv[1:]]
    disagree = not paths
    for path in paths:
        if path.is_dir():
            vectors = json.loads((path / "index.json").read_text())
            verdicts = [check(path, vector) for vector in vectors]
            for vector, verdict in zip(vectors, verdicts):
                print(f"{vector['name']}: {verdict or 'agrees'}")
            print(f"{verdicts.count(None)} of {len(vectors)} vectors agree")
            disagree |= not vectors or verdicts.count(None) < len(vectors)
            continue
        try:
            print(json.dumps(read(path.read_bytes()), indent=1, ensure_ascii=False))
        except Refused as reason:
            print(f"{path}: {reason}")
            disagree = True
    return int(disagree)


if __name__ == "__main__":
    sys.exit(main())
