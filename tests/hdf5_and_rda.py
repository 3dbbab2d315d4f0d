"""Small files as h5py and R write them, byte by byte, without h5py and without R."""

import struct
import zlib

import numpy as np

NOWHERE = 2**64 - 1  #: HDF5's address of what is not there


def hdf5_bytes(arrays, attributes=None, chunk=None, level=1):
    """A root group of these arrays and attributes as h5py writes it by default; chunk: rows of a chunk, packed by deflate, or contiguous.

    level: 0 for one tree node over all chunks, 1 for a node above two.
    """
    data = bytearray(b"\x89HDF\r\n\x1a\n" + bytes([0, 0, 0, 0, 0, 8, 8, 0]) + struct.pack("<HHI", 4, 16, 0))
    data += struct.pack("<QQQQ", 0, NOWHERE, 0, NOWHERE) + bytes(40)

    def put(block):
        data.extend(bytes(-len(data) % 8))
        start = len(data)
        data.extend(block)
        return start

    names, offsets = b"\0" * 8, {}
    for name in sorted(arrays):
        offsets[name] = len(names)
        names += name.encode() + b"\0" * (8 - len(name) % 8)
    heap = put(b"HEAP" + bytes(4) + struct.pack("<QQQ", len(names), NOWHERE, put(names)))
    entries = [struct.pack("<QQ24x", offsets[name], _hdf5_dataset(put, arrays[name], chunk, level)) for name in sorted(arrays)]
    symbols = put(b"SNOD" + struct.pack("<BBH", 1, 0, len(entries)) + b"".join(entries))
    tree = put(b"TREE" + struct.pack("<BBHQQ", 0, 0, 1, NOWHERE, NOWHERE) + struct.pack("<QQQ", 0, symbols, 0))
    more = put(b"".join(_hdf5_message(0xC, _hdf5_attribute(name, value)) for name, value in (attributes or {}).items()))
    root = _hdf5_message(0x10, struct.pack("<QQ", more, len(data) - more)) + _hdf5_message(0x11, struct.pack("<QQ", tree, heap))
    struct.pack_into("<Q", data, 0x40, put(struct.pack("<BxHII4x", 1, 3, 1, len(root)) + root))
    struct.pack_into("<Q", data, 0x28, len(data))
    return bytes(data)


def _hdf5_message(kind, body):
    body += bytes(-len(body) % 8)
    return struct.pack("<HHB3x", kind, len(body), 0) + body


def _hdf5_type(dtype):
    if dtype.kind == "f":
        return bytes([0x11, 0x20, 0x3F, 0]) + struct.pack("<IHHBBBBI", 8, 0, 64, 52, 11, 0, 52, 1023)
    return bytes([0x10, 8, 0, 0]) + struct.pack("<IHH", dtype.itemsize, 0, 8 * dtype.itemsize)


def _hdf5_space(shape):
    return bytes([1, len(shape), 0, 0, 0, 0, 0, 0]) + struct.pack(f"<{len(shape)}Q", *shape)


def _hdf5_attribute(name, value):
    value = np.asarray(value)
    parts = [name.encode() + b"\0", _hdf5_type(value.dtype), _hdf5_space(value.shape)]
    padded = b"".join(part + bytes(-len(part) % 8) for part in parts)
    return struct.pack("<BxHHH", 1, *map(len, parts)) + padded + value.tobytes()


def _hdf5_dataset(put, array, chunk, level):
    header = _hdf5_message(1, _hdf5_space(array.shape)) + _hdf5_message(3, _hdf5_type(array.dtype))
    if chunk is None:
        layout = struct.pack("<BBQQ", 3, 1, put(array.tobytes()), array.nbytes)
    else:
        shape = (chunk, *array.shape[1:])
        children = []
        for start in range(0, len(array), chunk):
            whole = np.zeros(shape, array.dtype)
            whole[: len(array[start : start + chunk])] = array[start : start + chunk]
            packed = zlib.compress(whole.tobytes(), 4)
            children.append((struct.pack("<II", len(packed), 0) + _hdf5_key(start, array.ndim), put(packed)))
        end = struct.pack("<II", 0, 0) + _hdf5_key(len(array), array.ndim)
        halves = [children[: len(children) // 2], children[len(children) // 2 :]] if level else [children]
        nodes = [(half[0][0], put(_hdf5_node(0, half, end))) for half in halves]
        tree = put(_hdf5_node(1, nodes, end)) if level else nodes[0][1]
        layout = struct.pack("<BBBQ", 3, 2, array.ndim + 1, tree) + struct.pack(f"<{array.ndim + 1}I", *shape, array.itemsize)
        header += _hdf5_message(0xB, struct.pack("<BB6xHHHH8sII", 1, 1, 1, 8, 1, 1, b"deflate\0", 4, 0))
    header += _hdf5_message(8, layout)
    return put(struct.pack("<BxHII4x", 1, 3, 1, len(header)) + header)


def _hdf5_key(start, rank):
    return struct.pack(f"<{rank + 1}Q", start, *[0] * rank)


def _hdf5_node(level, children, end):
    pairs = b"".join(key + struct.pack("<Q", child) for key, child in children)
    return b"TREE" + struct.pack("<BBHQQ", 1, level, len(children), NOWHERE, NOWHERE) + pairs + end


def rda_bytes(values, rate_hz=100.0):
    """An R workspace of one matrix (N, 6) as SMAC-Group's imudata holds it, before it is packed."""

    def text(word):
        return struct.pack(">II", 0x00040009, len(word)) + word.encode()

    def attribute(name, body):
        return struct.pack(">II", 0x402, 1) + text(name) + body

    names = [f"{what}. {axis}" for what in ("Gyro", "Accel") for axis in "XYZ"]
    dim = struct.pack(">IIii", 0xD, 2, *values.shape)
    dimnames = struct.pack(">III", 0x13, 2, 0xFE) + struct.pack(">II", 0x10, 6) + b"".join(map(text, names))
    attributes = attribute("dim", dim) + attribute("dimnames", dimnames) + attribute("freq", struct.pack(">IId", 0xE, 1, rate_hz))
    body = struct.pack(">II", 0x30E, values.size) + values.T.astype(">f8").tobytes() + attributes + struct.pack(">I", 0xFE)
    start = b"RDX2\nX\n" + struct.pack(">III", 2, 0x30401, 0x20300)
    return start + struct.pack(">II", 0x402, 1) + text("adis_16405_imu1") + body + struct.pack(">I", 0xFE)
