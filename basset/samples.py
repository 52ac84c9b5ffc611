"""Files of samples (CSV, npy, netCDF) as an array and its step."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from basset import _validate
from basset.kernels import Floats

__all__ = ["SUFFIXES", "columns", "read", "seconds"]

SUFFIXES = (".csv", ".npy", ".nc")
UNIFORM = 1e-4  # of a step by which times may be off, as they are rounded in files
COARSE = 1e-2  # of a step: times whose kind of number rounds them more are not known to be uniform
UNITS = {  # seconds; as UDUNITS and cftime spell them
    name: seconds
    for seconds, names in (
        (1e-9, "ns nsec nanosec nanosecond nanoseconds"),
        (1e-6, "us µs μs usec microsec microsecs microsecond microseconds"),
        (1e-3, "ms msec msecs millisec millisecs millisecond milliseconds"),
        (1.0, "s sec secs second seconds"),
        (60.0, "min mins minute minutes"),
        (3600.0, "h hr hrs hour hours"),
        (86400.0, "d day days"),
        (604800.0, "week weeks"),
    )
    for name in names.split()
}
KNOWN = "nanoseconds, microseconds, milliseconds, seconds, minutes, hours, days or weeks"
NAME = re.compile(r"(?:t|time|times)(?:\s*(?:[\[(]\s*(?P<bracket>[^\])]*?)\s*[\])]|[/,]\s*(?P<slash>\S+)|[\s_](?P<word>\S+)))?", re.IGNORECASE)
TIMELY = re.compile(r"time|date|clock|elapsed|(milli|micro|nano)?sec(ond)?s?\b|minutes?\b|hours?\b|days?\b", re.IGNORECASE)  # a name that may be of times
COUNTERS = {"frame", "row", "sample", "step"}  # names of columns that count rows, if they do so by ones beside others
GAPS = {"na", "n/a", "#n/a", "<na>", "null", "none", "nil", "missing"}  # words where a number is missing; NaN is a number
SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars", " ": "spaces"}  # in this order: commas may be in numbers
METRES = {"": 1.0, "um": 1e-6, "µm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1e3}
UNWRITTEN = {"f4": 9.969209968386869e36, "f8": 9.969209968386869e36, "i2": -32767, "i4": -2147483647}  # netCDF's own fill values


class Times(NamedTuple):
    """Times after the first in seconds (n+1,), and how far rounding may put one off a line through the first and the last."""

    values: Floats
    rounding: float


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is refused
def read(path: Path, dt: float | None = None, variable: str | None = None) -> tuple[Floats, float]:
    r"""Samples (n+1, columns) in the file's unit and their step (s), of a .csv, .npy (n+1, …) or .nc (netCDF-3) file; of .nc the `variable`, or the only one.

    .csv has a line of names or none and is separated by commas, semicolons, tabs, bars or spaces, the last four also with decimal commas; lines that begin
    with # are comments. Without `dt` the step comes from the times. In .csv these are the column named t or time, if need be with a unit as in
    "time (ms)" or "t_ms"; without names, and in .npy, the first column, in seconds. In .nc the coordinate with the attribute axis "T" or standard_name
    "time", units "… since …", the name t or time, or units of time, in its unit (without one: seconds); its dimension may stand anywhere. Columns of
    times are not samples, nor are leading ones that count the rows: pandas' index, and frame, row, sample or step by ones. Times that are not uniform or
    whose unit is not known, missing samples and files of any other form are refused in one sentence (ValueError, TypeError).

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "rates.csv"
    ...     _ = path.write_text("t (ms);g\n0,0;1,0\n0,5;2,0\n1,0;4,0\n")
    ...     samples, dt = read(path)
    >>> samples.ravel(), round(dt, 12)
    (array([1., 2., 4.]), 0.0005)
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"the file must end in {', '.join(SUFFIXES)}, got {str(path)!r}")
    if variable is not None and suffix != ".nc":
        raise ValueError(f"variable must be given for .nc files only, got {variable!r} for {str(path)!r}")
    if suffix == ".nc":
        times, values = _from_netcdf(path, variable, dt is None)
    else:
        times, values = (_from_csv if suffix == ".csv" else _from_npy)(path, dt is None)
    if len(values) < 2 or not values.size:
        raise ValueError(f"{str(path)!r} must hold at least two samples, got {len(values) if values.size else 0}")
    for name, array in (("samples", values), ("times", times.values if times else None)):
        if array is not None and not np.isfinite(array).all():
            first = np.argwhere(~np.isfinite(array))[0]
            hint = f": {_validate.FILL}" if np.isnan(array[tuple(first)]) else ""
            raise ValueError(f"{str(path)!r} must hold finite {name}, got {array[tuple(first)]} in row {first[0]} of the data{hint}")
    if dt is not None:
        return values, _validate.positive("dt", dt, "seconds")
    assert times is not None
    step, off = _evenness(times.values)
    if not step > 0.0 or off.max() > UNIFORM * step + min(times.rounding, COARSE * step):
        worst = int(off.argmax())
        coarse = f"; they are rounded by {times.rounding:.2g} s, too much for a step of {step:.2g} s" if times.rounding > COARSE * step > 0.0 else ""
        raise ValueError(f"{str(path)!r} must have uniform, rising times, got {times.values[worst]:.6g} s after the first as time {worst}{coarse}")
    return values, step


def columns(path: Path, names: Sequence[str] = ()) -> dict[str, Floats]:
    r"""Columns (n,) of a table by name, in the file's units, as it has them: .csv with its dialects as for `read`, or .nc (netCDF-3).

    `names` replace those of a .csv, or give them to one without. A cell of a .csv that is empty or says NA is NaN. Of .nc these are the variables along the
    one dimension of time and their coordinate of time, with their units after the names: "z (mm)". ValueError, with one sentence, for any other file.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "fall.csv"
    ...     _ = path.write_text("t (ms);z (mm)\n0,0;1,5\n0,5;\n")
    ...     columns(path)
    {'t (ms)': array([0. , 0.5]), 'z (mm)': array([1.5, nan])}
    """
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".txt", ".dat", ".tsv", ".nc"):
        raise ValueError(f"the file must end in .csv, .txt, .dat, .tsv or .nc, got {str(path)!r}")
    if suffix == ".nc":
        if names:
            raise ValueError(f"columns are named for files of text only, got {_validate.shown(list(names))} for {str(path)!r}")
        return _columns_of_netcdf(path)
    head, values = _table(path, True, gaps=True)
    found = list(names) or head
    if found is None:
        raise ValueError(
            f"{str(path)!r} must have names over its columns, or be given some, such as 't (s),z (mm)', got numbers alone in {values.shape[1]} columns"
        )
    if len(found) != values.shape[1]:
        raise ValueError(f"{str(path)!r} has {values.shape[1]} columns, and as many names must be given, got {_validate.shown(found)}")
    found = [name.strip() or f"column {k + 1}" for k, name in enumerate(found)]
    for name in found:
        if found.count(name) > 1:
            raise ValueError(f"{str(path)!r} must have columns of different names, got {name!r} {found.count(name)} times")
    return dict(zip(found, values.T, strict=True))


def seconds(name: str) -> float | None:
    """Seconds in the unit of times that stand under this name, as in "time (ms)" or "t_ms", 1 without any; None if it is no name of times.

    ValueError, with one sentence, for a unit that is none of time.

    >>> seconds("time (ms)"), seconds("t"), seconds("height")
    (0.001, 1.0, None)
    """
    if not _is_time(name):
        return None
    unit = _unit_in(name)
    found = _seconds(unit) if unit else 1.0
    if found is None:
        raise ValueError(f"times must be in {KNOWN}, got the unit {unit!r} in {name!r}")
    return found


def _unit_in(name: str) -> str:
    """The unit in a name of times, as in "time (ms)"; empty without any."""
    named = NAME.fullmatch(name.strip())
    return next((found for found in named.groups() if found), "") if named else ""


def _evenness(times: Floats) -> tuple[float, Floats]:
    """The mean step, and by how much each time is off a uniform one."""
    step = float((times[-1] - times[0]) / (len(times) - 1))
    return step, np.abs(times - (times[0] + step * np.arange(len(times))))


def _rises_evenly(column: Floats) -> bool:
    """Whether a column looks like times or a count of rows."""
    if len(column) < 3 or not np.isfinite(column).all():
        return False
    step, off = _evenness(column)
    return step > 0.0 and bool(off.max() <= COARSE * step)


def _times(path: Path, values: Floats, unit: float = 1.0, dtype: Any = None) -> Times:
    """Times as stored, in seconds after the first: a date far back costs no digits."""
    kind = np.dtype(dtype or values.dtype)
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    rounding = float(np.spacing(kind.type(largest))) * unit if kind.kind == "f" else 0.0
    return Times((values - values[:1]) * unit, rounding)


def _unit(path: Path, name: str, units: str | None) -> float:
    """Seconds in the unit of the times `name`: of its attribute ("ms", "days since 1970-01-01"), or of its name ("time (ms)"); 1 without any."""
    units = _unit_in(name) if units is None else units
    if not units.strip():
        return 1.0
    seconds = _seconds(re.split(r"\s+since\s", units.strip(), flags=re.IGNORECASE)[0])
    if seconds is None:
        raise ValueError(f"{str(path)!r} must have times in {KNOWN}, or the step be given, got the unit {units!r} for {name!r}")
    return seconds


def _seconds(word: str) -> float | None:
    """Seconds in a unit; None for what is none of time. Only whole words may be capital: Ms are megaseconds."""
    return UNITS.get(word.lower() if len(word) > 3 else word)


def metres(words: str, per_second: bool) -> float | None:
    """m, or m/s, in a unit of length or speed, 1 without any; None for what is none.

    >>> metres("cm s-1", True), metres("km", False), metres("knots", True)
    (0.01, 1000.0, None)
    """
    length = re.sub(r"\s*(?:/\s*s|[ .*]\s*s\s*(?:\^|\*\*)?-1)$", "", words) if per_second else words
    if words == "1":
        return 1.0
    return None if per_second and length == words != "" else METRES.get(length)


def _is_time(name: str) -> bool:
    """Whether a name says that times stand under it: t, time, time (ms), t_s; not t_star."""
    found = NAME.fullmatch(name.strip())
    return found is not None and (found["word"] is None or _seconds(found["word"]) is not None)


def _real(path: Path, values: Any) -> Any:
    array = np.asarray(values)
    if array.dtype.kind not in "fiu" or array.ndim == 0:
        raise ValueError(f"{str(path)!r} must hold an array of real numbers, got {_validate.shown(array)}")
    return array


def _first_column(path: Path, values: Floats, timed: bool, dtype: Any = None) -> tuple[Times | None, Floats]:
    """Times and samples where columns have no names."""
    columns = values.shape[1]
    if not timed:
        _no_times_first(path, values, "")
        return None, values
    if columns < 2:
        raise ValueError(f"{str(path)!r} must hold times (seconds) in its first column, or the step be given: it has one column")
    if columns > 2 and len(values) > 2 and np.array_equal(values[:, 0] - values[0, 0], np.arange(len(values))) and _rises_evenly(values[:, 1]):
        raise ValueError(
            f"{str(path)!r} must have its times first, got two columns that rise evenly, the first of which counts rows: leave it out, or name columns (.csv)"
        )
    return _times(path, values[:, 0], dtype=dtype), values[:, 1:]


def _no_times_first(path: Path, values: Floats, name: str) -> None:
    if values.shape[1] > 1 and _rises_evenly(values[:, 0]):
        named = f" {name!r}" if name else ""
        raise ValueError(
            f"{str(path)!r} must hold samples alone where the step is given, got a first column{named} that rises evenly, as times do: "
            "name it t if it holds times (.csv) or leave it out, else put another column first"
        )


def _samples_alone(path: Path, head: list[str], values: Floats, times: list[int], kept: list[int]) -> None:
    """Refuse samples that stand under a name of times (T, t_min), and times that stand under another name."""
    for k in times:
        step, off = _evenness(values[:, k])
        if not (step > 0.0 and off.max() <= step):
            raise ValueError(f"{str(path)!r} must have rising times in the column {head[k]!r}, as its name says: name it otherwise if it holds samples")
    for k in kept:
        if TIMELY.search(head[k]) and _rises_evenly(values[:, k]):
            raise ValueError(
                f"{str(path)!r} must hold samples beside the times, got the column {head[k]!r} that rises evenly, as times do: leave it out, or name it t"
            )


# CSV


def _from_csv(path: Path, timed: bool) -> tuple[Times | None, Floats]:
    head, values = _table(path, timed)
    if head is None:
        return _first_column(path, values, timed)
    for k, name in enumerate(head):
        if not name.strip() and not ((values[:, k] == np.rint(values[:, k])).all() or (np.diff(values[:, k]) > 0.0).all()):
            raise ValueError(f"{str(path)!r} must have a name for every column, got none for column {k + 1}, which is no index")
    index = next((k for k, name in enumerate(head) if not _is_index(name, values[:, k])), len(head))  # columns before it are pandas'
    found = [k for k, name in enumerate(head) if _is_time(name)]
    if timed and len(found) != 1:
        names = [head[k] for k in found] or head
        raise ValueError(f"{str(path)!r} must have one column named t or time, or the step be given, got the columns {_validate.shown(names)}")
    kept = [k for k in range(len(head)) if k >= index and k not in found]
    kept = kept or [k for k, name in enumerate(head) if name.strip().lower() in COUNTERS]
    if not kept:
        raise ValueError(f"{str(path)!r} must hold samples beside times, got the columns {_validate.shown(head)}")
    if not found:
        _no_times_first(path, values[:, kept], head[kept[0]])
    _samples_alone(path, head, values, [] if timed else found, kept)
    return _times(path, values[:, found[0]], _unit(path, head[found[0]], None)) if timed else None, values[:, kept]


def _is_index(name: str, column: Floats) -> bool:
    """Whether that column counts rows: as pandas writes it, without a name, "Unnamed: 0" when read and written again, or by its name."""
    counts, by_ones = bool((column == np.rint(column)).all() and (np.diff(column) > 0.0).all()), bool((np.diff(column) == 1.0).all())
    named = name.strip().lower()
    return not named or name.startswith("Unnamed:") or (named == "index" and counts) or (named in COUNTERS and counts and by_ones)


def _table(path: Path, timed: bool, gaps: bool = False) -> tuple[list[str] | None, Floats]:
    """(names or None, numbers) of a text file; `gaps`: what is missing is NaN, instead of refused."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{str(path)!r} must be a text file with commas, got one that is not UTF-8") from None
    numbered = [(number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip()]
    lines = [(number, line) for number, line in numbered if not line.lstrip().startswith("#")]
    if not lines:
        raise ValueError(f"{str(path)!r} must hold samples, got none")
    separator = _separator([line for _, line in lines[:2]])
    head = None
    first = _split(path, lines[0], separator)
    if _are_names(first, separator):
        head, lines = first, lines[1:]
    if not lines:
        raise ValueError(f"{str(path)!r} must hold samples, got none")
    commas = separator != "," and any("," in line for _, line in lines)
    rows: list[list[float]] = []
    for line in lines:
        cells = _split(path, line, separator)
        row = [number for cell in cells if (number := _number(cell, separator, gaps)) is not None]
        width = len(rows[0]) if rows else len(cells)
        if len(row) != width or len(cells) != width or (commas and "." in line[1]):
            by = SEPARATORS[separator] if width > 1 else ", ".join(SEPARATORS.values())
            form = f"{width} number{'s' * (width > 1)} in every row, separated by {by}" + " and with one decimal sign" * commas
            raise ValueError(f"{str(path)!r} must have {form}, got {_validate.shown(line[1].strip())} in row {line[0]}")
        rows.append(row)
    if head is None and (len(first) > 2 or not timed) and first == [str(k) for k in range(len(first))] and not _has_whole(path, lines[1:], separator):
        raise ValueError(
            f"{str(path)!r} must have names for its columns or none, got {_validate.shown(lines[0][1].strip())} in row {lines[0][0]}, as pandas numbers "
            "columns: give them names, or a decimal sign if these are samples"
        )
    if head is None:  # numpy.savetxt writes names as a comment
        comments = [line.lstrip()[1:].strip() for number, line in numbered if number < lines[0][0]]
        named = _split(path, (0, comments[-1]), separator) if comments else []
        head = named if len(named) == len(rows[0]) and any(map(_is_time, named)) else None
    elif len(head) == len(rows[0]) - 1 and _numbers_rows([row[0] for row in rows], separator):
        head = ["", *head]
    elif len(head) != len(rows[0]):
        raise ValueError(f"{str(path)!r} must have a name for every column, got {len(head)} names for {len(rows[0])} columns")
    return head, np.array(rows)


def _numbers_rows(column: list[float], separator: str) -> bool:
    """Whether a column that lacks a name may be the row names of R, which count from 1, or between spaces pandas' index."""
    return all(value >= (separator != " ") and value.is_integer() for value in column) and len(set(column)) == len(column)


def _are_names(cells: list[str], separator: str) -> bool:
    """Whether a first line holds names, and not numbers of which one is missing or cannot be read."""
    words = [cell.strip() for cell in cells if _number(cell, separator) is None]
    if len(words) < len(cells):  # names may be numbers, as depths are; pandas counts columns, beside an index without a name
        counts = not cells[0].strip() and cells[1:] == [str(k) for k in range(len(cells) - 1)]
        words = [cells[1]] if counts else [word for word in words if not re.match(r"[-+\N{MINUS SIGN}.\d]", word)]
    return any(re.search(r"\w", word) and word.lower() not in GAPS for word in words)


def _has_whole(path: Path, lines: list[tuple[int, str]], separator: str) -> bool:
    """Whether a number is written without a decimal sign, unlike pandas' floats."""
    return not lines or any(re.fullmatch(r"\s*[-+]?\d+\s*", cell) for line in lines for cell in _split(path, line, separator))


def _separator(lines: list[str]) -> str:
    """What separates numbers: that by which the second line falls into numbers, as the first may hold names."""
    probe = lines[-1].strip(" \r")
    for separator in SEPARATORS:
        try:
            cells = next(csv.reader([probe], delimiter=separator, skipinitialspace=True), [])
        except csv.Error:  # a field of more than 100 kB
            continue
        if len(cells) > 1 and all(_number(cell, separator) is not None for cell in cells):
            return separator
    alone = _number(probe.strip('"'), ",") is not None
    return "," if alone else next((separator for separator in SEPARATORS if separator in probe), ",")


def _split(path: Path, line: tuple[int, str], separator: str) -> list[str]:
    number, text = line
    if '"' not in text and separator != " ":
        return text.split(separator)
    try:
        return next(csv.reader([text.strip(" \r")], delimiter=separator, skipinitialspace=True, strict=True))
    except (csv.Error, StopIteration) as error:
        raise ValueError(f"{str(path)!r} must be a table, got {_validate.shown(text)} in row {number}: {error}") from None


def _number(cell: str, separator: str, gaps: bool = False) -> float | None:
    """A cell as a number; where commas do not separate they may be decimal. `gaps`: NaN where one is missing."""
    if gaps and (not cell.strip() or cell.strip().lower() in GAPS):
        return np.nan
    try:
        return float(cell if separator == "," else cell.replace(",", ".")) if "_" not in cell else None
    except ValueError:
        return None


# npy


def _from_npy(path: Path, timed: bool) -> tuple[Times | None, Floats]:
    with path.open("rb") as file:
        try:
            array = np.load(file, allow_pickle=False)
        except (ValueError, EOFError, BadZipFile):
            raise ValueError(f"{str(path)!r} must be an array that numpy.save wrote") from None
        if not isinstance(array, np.ndarray):
            raise ValueError(f"{str(path)!r} must be an array that numpy.save wrote, got several arrays")
    array = _real(path, array)
    if timed and array.ndim > 2:
        raise ValueError(f"{str(path)!r} must have at most two axes where its first column is the times, or the step be given, got shape {array.shape}")
    return _first_column(path, array.astype(np.float64).reshape(len(array), int(np.prod(array.shape[1:]))), timed, array.dtype)


# netCDF


def _opened(path: Path) -> tuple[Any, Any]:
    """The dataset in a netCDF-3 file with its fill values taken out, and as it is stored."""
    import xarray

    with path.open("rb") as file:  # xarray's own words for a file that is not there are long
        start = file.read(4)
    if start in (b"\x89HDF", b"CDF\x05"):
        kind = "CDF-5" if start[:1] == b"C" else "netCDF-4 (HDF5)"
        raise ValueError(f"{str(path)!r} must be a netCDF-3 file, got {kind}: convert it with nccopy -k classic")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what its attributes name may be missing
            opened = xarray.load_dataset(path, engine="scipy", decode_times=False, decode_timedelta=False, decode_coords="all")
            stored = xarray.load_dataset(path, engine="scipy", decode_cf=False)
    except Exception:  # whatever a damaged file leads to
        raise ValueError(f"{str(path)!r} must be a netCDF-3 file") from None
    return opened, stored


def _from_netcdf(path: Path, variable: str | None, timed: bool) -> tuple[Times | None, Floats]:
    opened, stored = _opened(path)
    others = [name for name in opened.data_vars if name != variable and _rank(opened, name) < UNIT_ONLY]
    if len(others) < len(opened.data_vars):  # a temperature T may be all there is
        opened = opened.set_coords(others)
    names = list(map(str, opened.data_vars))
    if not names:
        raise ValueError(f"{str(path)!r} must hold a variable beside coordinates")
    if variable is None and len(names) != 1:
        raise ValueError(f"a variable of {str(path)!r} must be named: {', '.join(map(repr, names))}")
    found = opened[_validate.choice("variable", variable or names[0], names)]
    if not _real(path, found.values).size:
        raise ValueError(f"{str(path)!r} must hold at least two samples, got {found.name!r} without any")
    time = _time_of(path, found, timed)
    known = [dim for dim in found.dims if _is_time(str(dim))]
    if time is None:
        if len(known) != 1 and found.ndim > 1:
            raise ValueError(f"{str(path)!r} must name its dimension of time t or time, got {found.name!r} with the dimensions {_listed(found.dims)}")
        dim, times = known[0] if known else found.dims[0], None
        if not known and dim in found.coords and _is_of_space({key: str(value).strip() for key, value in found.coords[dim].attrs.items()}):
            raise ValueError(f"{str(path)!r} must hold samples in time, got {found.name!r} along {str(dim)!r}")
    else:
        dim, values = (time.dims[0], np.empty(0)) if time.ndim == 1 and not timed else _along(path, time, stored)
        if known and dim not in known:
            raise ValueError(f"{str(path)!r} must have one dimension of time, got {str(known[0])!r} and, by {str(time.name)!r}, {str(dim)!r}")
        units = time.attrs.get("units")
        times = _times(path, values, _unit(path, str(time.name), None if units is None else str(units)), _stored(time)) if timed else None
    values = np.moveaxis(_present(path, found, stored), found.dims.index(dim), 0).astype(np.float64)
    return times, values.reshape(len(values), int(np.prod(values.shape[1:])))


def _columns_of_netcdf(path: Path) -> dict[str, Floats]:
    """The coordinate of time, in seconds, and what goes along it."""
    opened, stored = _opened(path)
    dims = {dim for dim in opened.dims if any(_rank(opened, name) < UNIT_ONLY for name in opened.variables if opened[name].dims == (dim,))}
    if len(dims) != 1:
        raise ValueError(f"{str(path)!r} must have one dimension of time, known by a coordinate called t or time, got {_listed(dims) or 'none'}")
    (dim,) = dims
    own = [name for name in opened.variables if opened[name].dims == (dim,) and opened[name].dtype.kind in "fiu"]
    time = min(own, key=lambda name: (_rank(opened, name), name != dim))
    found: dict[str, Floats] = {}
    for name in own:
        attributes = opened[name].attrs
        unit, factor = str(attributes.get("units", "")), 1.0
        if "si_factor" in attributes:  # as saltation writes what has the units d and u*
            unit, factor = str(attributes.get("si_units", "")), float(attributes["si_factor"])
        values = np.where(_marked(stored[name]), np.nan, opened[name].to_numpy().astype(np.float64))
        if name == time:
            found["time (s)"] = values * factor * _unit(path, str(name), unit or None)
        else:
            found[f"{name} ({unit})" if unit else str(name)] = values * factor
    return found


UNIT_ONLY = 3  # the weakest sign of time


def _rank(opened: Any, name: Any) -> float:
    """How surely a variable holds times: 0 by its attributes, 1 by a date, 2 by its name, 3 by its unit; inf: it does not."""
    attributes = {key: str(value).strip() for key, value in opened[name].attrs.items()}
    if attributes.get("axis") == "T" or attributes.get("standard_name") == "time" or attributes.get("_CoordinateAxisType") == "Time":
        return 0
    if re.search(r"\ssince\s", attributes.get("units", "")):
        return 1
    units = attributes.get("units", "")
    if _is_of_space({**attributes, "units": ""}):
        return np.inf
    timely = _seconds(units) is not None
    named = _is_time(str(name)) and (len(str(name)) > 1 or not units or timely)  # t may be a temperature
    return 2 if named else UNIT_ONLY if timely else np.inf


def _is_of_space(attributes: dict[str, str]) -> bool:
    """Whether a coordinate says that it is not one of time: of space, or whatever else has a standard name or a unit."""
    other = attributes.get("standard_name", "forecast_period") not in ("forecast_period", "forecast_reference_time")
    return other or attributes.get("axis") in ("X", "Y", "Z") or "positive" in attributes or attributes.get("units", "") not in ("", "1")


def _time_of(path: Path, found: Any, timed: bool) -> Any:
    """The coordinate that holds the times of `found`, or None."""
    ranks = {name: _rank(found.coords, name) for name in found.coords if found.coords[name].ndim}
    best = min(ranks.values(), default=np.inf)
    names = [name for name, rank in ranks.items() if rank == best < np.inf]
    if timed and not names:
        raise ValueError(
            f"{str(path)!r} must have a coordinate of time along one of its dimensions {_listed(found.dims)}, known by axis 'T', standard_name "
            "'time', the name t or time, or its units, or the step be given"
        )
    if len({found.coords[name].dims for name in names}) == 1:  # several along one dimension: that of its name is its own
        own = [name for name in names if name in found.dims]
        names = own or (names if timed else names[:1])
    if len(names) > 1:
        raise ValueError(f"{str(path)!r} must have one coordinate of time, got {_listed(names)}: give one of them the attribute axis 'T'")
    return found.coords[names[0]] if names else None


def _along(path: Path, time: Any, stored: Any) -> tuple[Any, Floats]:
    """(dimension, times as stored): of each row the same where there are several, as in (trajectory, obs)."""
    values = _present(path, time, stored).astype(np.float64)
    for axis, dim in enumerate(time.dims):
        rows = np.moveaxis(values, axis, -1).reshape(-1, values.shape[axis])
        if (rows == rows[:1]).all() and (values.ndim == 1 or values.shape[axis] > 1):
            return dim, rows[0]
    raise ValueError(f"{str(path)!r} must have the same times in every row of {time.name!r} {_listed(time.dims)}: take one of them")


def _present(path: Path, found: Any, stored: Any) -> Any:
    """The values of a variable; refused where some were not written."""
    values = _real(path, found.values)
    missing = np.isnan(values) | _marked(stored[found.name])
    if missing.any():
        raise ValueError(
            f"{str(path)!r} must have no missing values in {found.name!r}, got {missing.sum()} of {missing.size}, the first in row "
            f"{np.argwhere(missing)[0][0]}: {_validate.FILL}"
        )
    return values


def _marked(stored: Any) -> Any:
    """Which values of a variable as it is stored are missing by its attributes: as CF has it, by a fill value or out of the valid range."""

    def numbers(name: str) -> Any:
        try:
            found = np.atleast_1d(np.asarray(stored.attrs.get(name, []), dtype=np.float64))
        except (TypeError, ValueError):
            found = np.empty(0)
        return found.astype(values.dtype) if values.dtype.kind == "f" else found  # 1e20 is another number in single precision

    values = stored.values
    if {"_FillValue", "missing_value"}.isdisjoint(stored.attrs):
        marks = np.array([UNWRITTEN[code]] if (code := values.dtype.str[1:]) in UNWRITTEN else [])
    else:
        marks = np.concatenate([numbers("_FillValue"), numbers("missing_value")])
    missing = np.isin(values, marks.astype(values.dtype) if values.dtype.kind == "f" else marks)
    if "_Unsigned" not in stored.attrs:
        least, most = limits if len(limits := numbers("valid_range")) == 2 else ([*numbers("valid_min"), -np.inf][0], [*numbers("valid_max"), np.inf][0])
        missing |= (values < least) | (values > most)
    return missing


def _stored(found: Any) -> Any:
    return found.encoding.get("dtype") or found.dtype


def _listed(names: Any) -> str:
    return ", ".join(repr(str(name)) for name in names)
