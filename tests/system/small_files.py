"""Small files that expand, each read in a separate process: ``python -m tests.system.small_files FOLDER``.

Prints one line for each: its name, the memory (MiB) that reading it took, the error, and what it says.
"""

import gzip
import os
import resource
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq

from astb.exchange import import_file
from astb.frames_import import LogKeys
from bench_protocol.dbc import read_dbc
from bench_protocol.input_limits import read_toml
from bench_records.notes import NOTES, add_note, notes_of
from bench_records.result import read_result
from bench_sim.fmu.description import read_fmu
from test_plans.specimen import read_specimen

#: The memory limit at once: refused files cost none.
ADDRESSES = 3 << 30
MANY = 15_000_000
DBC = 'VERSION ""\nBU_: X\nBO_ 1 M: 8 X\n SG_ S : 0|8@1+ (1,0) [0|0] "" X\n'
PAGES = ' SG_ A M : 0|8@1+ (1,0) [0|0] "" X\n SG_ C m1 : 16|8@1+ (1,0) [0|0] "" X\n\nSG_MUL_VAL_ 1 C A 0-90000000;\n'
#: A MiB of lines for each form.
FRAMES = {
    form: (line.ljust(1023) + b"\n") * 1024
    for form, line in {"log": b"(1.0) c 001#00", "asc": b"1.0 1 1 Rx d 0", "trc": b"1) 1.0 0001 0"}.items()
}
Reader = Callable[[Path], object]


def imported(path: Path) -> object:
    return import_file(path, path.parent / "run")


def by_dbc(path: Path) -> object:
    dbc = path.parent / "rig.dbc"
    dbc.write_text(DBC)
    return import_file(path, path.parent / "run", LogKeys(dbc, None, None, None))


def noted(path: Path) -> object:
    (path.parent / NOTES).mkdir()
    path.rename(path.parent / NOTES / "0001.json")
    return notes_of(path.parent)


def text(content: str) -> bytes:
    return content.encode()


def packed(content: bytes, times: int) -> bytes:
    """``content`` so many times, packed."""
    return gzip.compress(content, 1) * times


def blf(path: Path) -> None:
    """A container of zeros."""
    head = b"LOGG" + struct.pack("<L", 144) + bytes(136)
    packed = zlib.compress(bytes(1 << 28))
    body = (
        struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed), 10)
        + struct.pack("<H6xL4x", 2, 1 << 28)
        + packed
    )
    path.write_bytes(head + (body + bytes(-len(body) % 4)))


def zipped(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.bin", "w") as file:
        for _ in range(600):
            file.write(bytes(1 << 20))


def entities(path: Path) -> None:
    lines = [f'<!ENTITY e{k} "{f"&e{k - 1};" * 50}">' for k in range(1, 9)]
    body = (
        f'<!DOCTYPE a [<!ENTITY e0 "xxxx">{"".join(lines)}]><fmiModelDescription>&e8;</fmiModelDescription>'
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", body)


def parquet(path: Path) -> None:
    zeros = pa.array(np.zeros(1 << 20, np.int8))
    table = pa.table({"time_s": zeros, "left.height [mm]": zeros, "b": zeros})
    with pq.ParquetWriter(path, table.schema) as file:
        for _ in range(40):
            file.write_table(table)


def parquet_text(path: Path) -> None:
    words = pa.DictionaryArray.from_arrays(pa.array(np.zeros(20_000, np.int32)), pa.array(["x" * 100_000]))
    pq.write_table(pa.table({"time_s": words}), path, compression="zstd")


def parquet_lists(path: Path) -> None:
    lists = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(1 << 20, np.int8)), 1024)
    table = pa.table({"time_s": lists})
    with pq.ParquetWriter(path, table.schema) as file:
        for _ in range(120):
            file.write_table(table)


def arrow(path: Path) -> None:
    zeros = pa.array(np.zeros(1 << 20))
    batch = pa.record_batch([zeros, zeros, zeros], ["time_s", "b", "c"])
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.OSFile(str(path), "wb") as file, pa.ipc.new_file(file, batch.schema, options=options) as out:
        for _ in range(40):
            out.write_batch(batch)


def arrow_text(path: Path) -> None:
    words = pa.DictionaryArray.from_arrays(pa.array(np.zeros(20_000, np.int32)), pa.array(["x" * 100_000]))
    pyarrow.feather.write_feather(pa.table({"time_s": words}), str(path), compression="zstd")


def arrow_nulls(path: Path) -> None:
    with pa.OSFile(str(path), "wb") as file, pa.ipc.new_file(file, pa.schema([("time_s", pa.null())])) as out:
        out.write_batch(pa.record_batch([pa.nulls(90_000_000)], ["time_s"]))


def mdf(path: Path) -> None:
    import asammdf

    zeros = np.zeros(MANY, np.int8)
    with asammdf.MDF(version="4.10") as made:
        made.append(
            [asammdf.Signal(zeros, np.arange(MANY) * 1e-3, name=name) for name in ("left.height", "b", "c")]
        )
        made.save(path, compression=2)


def mdf_text(path: Path) -> None:
    import asammdf
    from asammdf.blocks.conversion_utils import from_dict

    mapping = {"val_0": 0, "text_0": "x" * 50_000, "default": ""}
    one = asammdf.Signal(
        np.zeros(100_000, np.uint8), np.arange(1e5), name="rig.state", conversion=from_dict(mapping)
    )
    with asammdf.MDF(version="4.10") as made:
        made.append([one])
        made.save(path, compression=2)


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(3 << 30)


def photo(path: Path) -> object:
    return add_note(path.parent, "text", "by", path)


#: By the name of the file: what it holds, or what writes it, and its reader.
CASES: dict[str, tuple[bytes | Callable[[Path], None], Reader]] = {
    "key.toml": (text("a." * 32_768 + "b = 1"), read_toml),
    "header.toml": (text("[a" + ' . "a"' * 16_000 + "]"), read_toml),
    "inline.toml": (text("a = [{" + "a." * 32_000 + "b = 1}]"), read_toml),
    "open.toml": (text("a." * 500_000), read_toml),
    "tables.toml": (text("".join(f"[{k:x}{'.a' * 30}]\n" for k in range(60_000))), read_toml),
    "specimen.toml": (text("a." * 32_768 + "b = 1"), lambda path: read_specimen(str(path))),
    "lists.json": (text('{"a": [' + "[]," * 5_000_000 + "[]]}"), noted),
    "deep.json": (text("[" * 1_000_000), noted),
    "result.json": (text("[" * 1_000_000), lambda path: read_result(path.parent)),
    "length.dbc": (text(DBC.replace("M: 8", "M: 90000000")), read_dbc),
    "lengths.dbc": (text("".join(f"BO_ {k} M{k}: 60000 X\n\n" for k in range(1, 2000))), read_dbc),
    "signal.dbc": (text(DBC.replace("0|8@1", "400000000|8@0")), read_dbc),
    "pages.dbc": (text(DBC + PAGES), read_dbc),
    "zeros.log.gz": (packed(bytes(1 << 22), 300), imported),
    "frames.log.gz": (packed(FRAMES["log"], 200), by_dbc),
    "frames.asc.gz": (packed(b"base hex\n", 1) + packed(FRAMES["asc"], 200), by_dbc),
    "frames.trc.gz": (packed(FRAMES["trc"], 200), by_dbc),
    "zeros.blf": (blf, by_dbc),
    "zeros.blf.gz": (packed(b"LOGG" + struct.pack("<L", 144), 1) + packed(bytes(1 << 22), 300), by_dbc),
    "object.blf": (
        b"LOGG" + struct.pack("<L", 144) + bytes(136) + struct.pack("<4sHHLL", b"LOBJ", 16, 1, 2**32 - 1, 10),
        by_dbc,
    ),
    "zeros.parquet": (parquet, imported),
    "text.parquet": (parquet_text, imported),
    "lists.parquet": (parquet_lists, imported),
    "zeros.arrow": (arrow, imported),
    "text.arrow": (arrow_text, imported),
    "nulls.arrow": (arrow_nulls, imported),
    "zeros.mf4": (mdf, imported),
    "text.mf4": (mdf_text, imported),
    "commas.csv": (b"time_s" + b",a" * 9_000 + b"\n" + (b"," * 9_000 + b"\n") * 300, imported),
    "zip.fmu": (zipped, read_fmu),
    "entities.fmu": (entities, read_fmu),
    "photo.jpg": (sparse, photo),
}


def memory(field: str) -> int:
    """A field of this process's status, in KiB."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition(f"{field}:")[2].split()[0])


def read(name: str, path: Path, reader: Reader) -> str:
    """Read a file; return the result, in one line."""
    before = memory("VmRSS")
    resource.setrlimit(resource.RLIMIT_AS, ((memory("VmSize") << 10) + ADDRESSES,) * 2)
    try:
        reader(path)
        ended = "read\t"
    except Exception as error:
        ended = f"{type(error).__name__}\t{str(error)[:200]!r}"
    return f"{name}\t{(memory('VmHWM') - before) // 1024}\t{ended}"


def main(folder: Path, names: list[str]) -> None:
    for name, (content, reader) in CASES.items():
        if names and name not in names:
            continue
        path = folder / name.replace(".", "-") / name
        path.parent.mkdir()
        if not (writing := os.fork()):  # writing takes memory, too
            try:
                path.write_bytes(content) if isinstance(content, bytes) else content(path)
            except ImportError:
                print(f"{name}\t0\tnot written\t", flush=True)
            os._exit(0)
        os.waitpid(writing, 0)
        if not path.exists():
            continue
        if not (reading := os.fork()):
            size = path.stat().st_size >> 10
            print(read(name, path, reader), size, sep="\t", flush=True)
            os._exit(0)
        os.waitpid(reading, 0)  # imported libraries may have children, too
        path.unlink(missing_ok=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
