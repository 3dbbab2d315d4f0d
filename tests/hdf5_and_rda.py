"""Small files of public sets: HDF5 by h5py, and R's byte by byte, without R."""

import io
import struct


def hdf5_bytes(arrays, attributes=None, chunk=None):
    """A root group of these arrays and attributes as h5py writes it by default; chunk: rows of a chunk packed by deflate, or contiguous."""
    import h5py

    packing = {} if chunk is None else {"compression": "gzip"}
    file = io.BytesIO()
    with h5py.File(file, "w") as root:
        for name, array in arrays.items():
            root.create_dataset(name, data=array, chunks=None if chunk is None else (chunk, *array.shape[1:]), **packing)
        root.attrs.update(attributes or {})
    return file.getvalue()


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
