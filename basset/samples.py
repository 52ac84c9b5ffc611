"""Samples that users have: CSV, npy and netCDF files as an array and its step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from basset import _validate
from basset.kernels import Floats

SUFFIXES = (".csv", ".npy", ".nc")
UNIFORM = 1e-4  # of a step by which times may be off, as they are rounded in files


def read(path: Path, dt: float | None = None, variable: str | None = None) -> tuple[Floats, float]:
    r"""Samples (n+1, columns) and their step (seconds).

    Parameters
    ----------
    path : Path
        .csv with or without a line of names, .npy (n+1, …), .nc.
    dt : float, seconds, or None
        The step; None: from the times, which are the first column of .csv and .npy, and the coordinate of the first
        dimension in .nc.
    variable : str or None
        Which variable of .nc; None: the only one.

    Returns
    -------
    ndarray of float64 (n+1, columns), in the file's unit; float, seconds

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError, TypeError
        In one sentence, if it holds no such samples or the times are not uniform, or dt is no positive number.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "rates.csv"
    ...     _ = path.write_text("t,g\n0.0,1.0\n0.5,2.0\n1.0,4.0\n")
    ...     samples, dt = read(path)
    >>> samples.ravel(), dt
    (array([1., 2., 4.]), 0.5)
    """
    if path.suffix not in SUFFIXES:
        raise ValueError(f"the file must end in {', '.join(SUFFIXES)}, got {str(path)!r}")
    if variable is not None and path.suffix != ".nc":
        raise ValueError(f"a variable is named for .nc files only, got {variable!r} for {str(path)!r}")
    times, values = _from_netcdf(path, variable, dt is None) if path.suffix == ".nc" else (None, _from_csv(path) if path.suffix == ".csv" else _from_npy(path))
    if dt is None and times is None:
        if values.shape[1] < 2:
            raise ValueError(f"{str(path)!r} must hold times (seconds) in its first column, or the step be given: it has one column")
        times, values = values[:, 0], values[:, 1:]
    if len(values) < 2:
        raise ValueError(f"{str(path)!r} must hold at least two samples, got {len(values)}")
    for name, array in (("times", times), ("samples", values)):
        if array is not None and not np.isfinite(array).all():
            raise ValueError(f"{str(path)!r} must hold finite {name}, got {array[~np.isfinite(array)][0]}")
    if dt is not None:
        return values, _validate.positive("dt", dt, "seconds")
    assert times is not None
    step = float((times[-1] - times[0]) / (len(times) - 1))
    off = np.abs(times - (times[0] + step * np.arange(len(times))))
    if not step > 0.0 or off.max() > UNIFORM * step:
        raise ValueError(f"{str(path)!r} must have uniform, rising times, got {times[int(off.argmax())]:.6g} s as time {int(off.argmax())}")
    return values, step


def _columns(path: Path, values: Any) -> Floats:
    array = np.asarray(values)
    if array.dtype.kind not in "fiu" or array.ndim == 0:
        raise ValueError(f"{str(path)!r} must hold an array of real numbers, got {_validate.shown(array)}")
    return array.astype(np.float64).reshape(len(array), -1)


def _from_csv(path: Path) -> Floats:
    try:
        rows = [line.split(",") for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip() and not line.startswith("#")]
    except UnicodeDecodeError:
        raise ValueError(f"{str(path)!r} must be a text file with commas, got one that is not UTF-8") from None
    first = 0
    if rows and not all(_is_number(cell) for cell in rows[0]):
        first = 1
    if len(rows) == first:
        raise ValueError(f"{str(path)!r} must hold samples, got none")
    for number, row in enumerate(rows[first:], first + 1):
        if len(row) != len(rows[first]) or not all(_is_number(cell) for cell in row):
            raise ValueError(f"{str(path)!r} must have {len(rows[first])} numbers in every row, got {_validate.shown(','.join(row))} in row {number}")
    return np.array([[float(cell) for cell in row] for row in rows[first:]])


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _from_npy(path: Path) -> Floats:
    try:
        values = np.load(path, allow_pickle=False)
    except (ValueError, EOFError):
        raise ValueError(f"{str(path)!r} must be an array that numpy.save wrote") from None
    return _columns(path, values)


def _from_netcdf(path: Path, variable: str | None, timed: bool) -> tuple[Floats | None, Floats]:
    import xarray

    path.open("rb").close()  # xarray's own words for a file that is not there are long
    try:
        opened = xarray.load_dataset(path, engine="scipy", decode_times=False)
    except (TypeError, ValueError, OSError):
        raise ValueError(f"{str(path)!r} must be a netCDF-3 file") from None
    names = list(map(str, opened.data_vars))
    if variable is None and len(names) != 1:
        raise ValueError(f"a variable of {str(path)!r} must be named: {', '.join(map(repr, names))}")
    name = _validate.choice("variable", variable or names[0], names)
    found = opened[name]
    values = _columns(path, found.values)
    if not timed:
        return None, values
    if found.dims[0] not in opened.coords:
        raise ValueError(f"{str(path)!r} must have a coordinate {str(found.dims[0])!r} (times in seconds), or the step be given")
    return np.asarray(opened[found.dims[0]].values, dtype=np.float64), values
