"""`basset sum` and `basset weights` for other programs: the promise on the printed digits, and compiled code that repeats a stream."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from click.testing import CliRunner

import basset
from basset import cli, exported

NEAR, FAR = 2e-3, 0.4
KERNELS = {
    "basset": ((), basset.BassetKernel()),
    "mei_adrian": (("--kernel", "mei_adrian", "--slip", 0.01, "--diameter", 1e-3), basset.MeiAdrianKernel(0.01, 1e-3, 1e-6)),
    "bubble": (("--kernel", "bubble", "--diameter", 1e-3), basset.BubbleKernel(1e-3, 1e-6)),
    "slip_sphere": (("--kernel", "slip_sphere", "--slip-length", 5e-5, "--diameter", 1e-3), basset.SlipSphereKernel(5e-5, 1e-3, 1e-6)),
}
CASES = [("bubble", 3, 1e-6), ("slip_sphere", 2, 1e-4), ("basset", 1, 1e-3), ("basset", 3, 1e-6), ("basset", 10, 1e-12), ("mei_adrian", 2, 1e-9)]

C_STREAM = """
#include <stdio.h>
#include "made.h"
int main(void)
{
    double rate, jump;
    basset_history h = {0};
    while (scanf("%lf %lf", &rate, &jump) == 2) {
        printf("%.17g\\n", basset_push(&h, rate));
        basset_jump(&h, jump);
    }
    printf("%.17g\\n%.17g\\n", basset_test(), basset_sum(0.1));
    return 0;
}
"""
FORTRAN_STREAM = """
program main
  use, intrinsic :: iso_fortran_env, only: real64
  use basset_sum, only: history, deviation, kernel_sum
  implicit none
  type(history) :: h
  real(real64) :: rate, change, value
  integer :: status
  do
    read (*, *, iostat=status) rate, change
    if (status /= 0) exit
    call h%push(rate, value)
    print '(es25.17e3)', value
    call h%jump(change)
  end do
  print '(es25.17e3)', deviation(), kernel_sum(0.1_real64)
end program main
"""
C_WEIGHTS = '#include <stdio.h>\n#include "made.h"\nint main(void) { printf("%.17g\\n", basset_test()); return 0; }\n'
FORTRAN_WEIGHTS = "program main\n  use basset_weights, only: deviation\n  print '(es25.17e3)', deviation()\nend program main\n"
LANGUAGES = {
    "c": ("cc", ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"), "made.h", "main.c", ("main.c", "-lm")),
    "fortran": ("gfortran", ("-std=f2008", "-Wall", "-Wextra"), "made.f90", "main.f90", ("made.f90", "main.f90")),
}


def printed(*words):
    result = CliRunner().invoke(cli.main, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result.output


def sum_of(name, order, rtol, form):
    return printed("sum", "--near", NEAR, "--far", FAR, "--rtol", rtol, "--order", order, "--format", form, *KERNELS[name][0])


def compiled(form, text, program, folder, given=""):
    """Numbers that a compiled program prints; skipped where there is no compiler."""
    compiler, options, made, main, files = LANGUAGES[form]
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} on this machine")
    (folder / made).write_text(text)
    (folder / main).write_text(program)
    subprocess.run([compiler, *options, *files[:-1], files[-1], "-o", "made"], cwd=folder, check=True)
    return np.array(subprocess.run([folder / "made"], input=given, capture_output=True, text=True, check=True).stdout.split(), dtype=float)


def pushed(name, order, rtol, rates, jumps):
    """The stream of this package, one sample after the other."""
    dt = NEAR / (order // 2 + 1)
    plan = basset.Exponential(order, rtol).plan(dt, FAR - dt, KERNELS[name][1])
    state, values = plan.start(), []
    for rate, jump in zip(rates, jumps, strict=True):
        plan.push(state, rate)
        values.append(plan.value(state))
        plan.jump(state, jump)
    return np.array(values)


@pytest.mark.parametrize("form", ["c", "fortran"])
@pytest.mark.parametrize(("name", "order", "rtol"), CASES)
def test_compiled_code_repeats_the_stream(form, name, order, rtol, tmp_path):
    draw = np.random.default_rng(18)
    rates, jumps = draw.normal(size=150), np.where(draw.random(150) < 0.1, 0.1 * draw.normal(size=150), 0.0)
    jumps[0] = 1.0
    given = "".join(f"{rate!r} {jump!r}\n" for rate, jump in zip(rates.tolist(), jumps.tolist(), strict=True))
    program = C_STREAM if form == "c" else FORTRAN_STREAM
    *values, deviation, at = compiled(form, sum_of(name, order, rtol, form), program, tmp_path, given)
    expected = pushed(name, order, rtol, rates, jumps)
    assert np.abs(values - expected).max() <= 1e-12 * np.abs(expected).max()
    assert abs(deviation) < 1e-13
    assert abs(at - basset.ExponentialSum.fit(NEAR, FAR, rtol, KERNELS[name][1])(0.1)) < 1e-14 * at


@pytest.mark.parametrize("form", ["c", "fortran"])
def test_compiled_code_goes_no_further_than_the_sum(form, tmp_path):
    text = printed("sum", "--near", 1.0, "--far", 9.0, "--rtol", 1e-2, "--order", 1, "--format", form)
    *values, deviation, _ = compiled(form, text, C_STREAM if form == "c" else FORTRAN_STREAM, tmp_path, "1.0 0.0\n" * 12)
    assert np.isfinite(values).tolist() == [True] * 10 + [False] * 2  # nodes 0 to 9
    assert abs(deviation) < 1e-13


@pytest.mark.parametrize("form", ["c", "fortran"])
@pytest.mark.parametrize("words", [("brush", "--steps", 7), ("daitche", "--steps", 1500, "--dt", 0.1, "--input", "slip")], ids=["few", "many"])
def test_compiled_weights_give_the_worked_value(form, words, tmp_path):
    text = printed("weights", *words, "--format", form)
    assert abs(compiled(form, text, C_WEIGHTS if form == "c" else FORTRAN_WEIGHTS, tmp_path)) < 1e-13


@pytest.mark.parametrize(("near", "far", "steps"), [(1e-3, 1e6, 2_000_000_000), (1e-6, 1e5, 2**31 - 2)])
def test_long_sums_are_counted_by_integers_of_32_bits(near, far, steps):
    words = ("sum", "--near", near, "--far", far, "--rtol", 1e-4)
    assert json.loads(printed(*words, "--format", "json"))["steps"] == steps
    assert f"basset_steps = {steps} }}" in printed(*words, "--format", "c")


def read_back(text, form):
    """Weights and rates from the printed digits alone."""
    if form == "json":
        found = json.loads(text)
        return found["weights"], found["rates"]
    if form in ("csv", "table"):
        rows = [re.split(r",|  +", line) for line in text.splitlines() if re.match(r"\d", line)]
        return [float(row[1]) for row in rows], [float(row[0]) for row in rows]
    brackets = {"c": r"basset_{}\[\d+\] = \{{([^}}]*)\}}", "fortran": r":: {}\(terms\) = \[([^]]*)\]"}[form]
    texts = (re.search(brackets.format(name), text)[1].replace("&", "").replace("d", "e") for name in ("weight", "rate"))
    return tuple([float(number) for number in found.split(",")] for found in texts)


@pytest.mark.parametrize("form", exported.FORMATS)
@pytest.mark.parametrize(("name", "order", "rtol"), CASES)
def test_the_printed_digits_keep_the_promise(form, name, order, rtol):
    weights, rates = read_back(sum_of(name, order, rtol, form), form)
    kernel = KERNELS[name][1]
    fitted = basset.ExponentialSum.fit(NEAR, FAR, rtol, kernel)
    assert sorted(rates) == fitted.rates.tolist()
    lags = np.geomspace(NEAR, FAR, 50_000)
    lags[-1] = FAR
    assert np.abs(np.exp(-np.outer(lags, rates)) @ weights / kernel(lags) - 1.0).max() <= rtol
    assert basset.ExponentialSum(np.array(weights), np.array(rates), NEAR, FAR, kernel).max_relative_error() <= rtol


@pytest.mark.parametrize("form", exported.FORMATS)
def test_what_is_printed_says_what_it_promises_and_works_an_example(form):
    text = " ".join(sum_of("basset", 3, 1e-6, form).split())
    dt = NEAR / 2
    rates = 1.0 / np.arange(1.0, 102.0)
    value = basset.cumulate(rates, dt, basset.Daitche(3), initial_slip=1.0)[-1]
    worked = re.search(r"H at node 100 is ([\d.]+\d)|test_value|\"value\": ([\d.]+)|value ?/ ?\(?([\d.]+(?:d\+00)?)\)? - 1", text)
    found = float(next(group for group in worked.groups() if group).replace("d", "e"))
    assert abs(found / value - 1.0) < 1e-6
    assert "|sum/K - 1| <= 1e-06" in text


def test_the_recursion_in_json_is_the_stream():
    facts = json.loads(sum_of("basset", 3, 1e-6, "json"))
    last, window = facts["last"], facts["window"]
    start, entry, gain, loss, newest = (np.array(facts[name]) for name in ("start", "entry", "gain", "loss", "newest"))
    sample, term, coming = np.zeros(last + 1), np.zeros(facts["terms"]), np.zeros(window)
    rates, jumps, values = np.cos(np.arange(30.0)), np.arange(30) % 7 == 0, []
    for n, (rate, jump) in enumerate(zip(rates, jumps, strict=True)):
        sample = np.append(rate, sample[:-1])
        gained = entry @ sample if n == last else gain * sample[last] if n > last else 0.0
        term = term + gained - loss * term
        values.append(coming[0] + (start[n] if n < last else newest) @ sample + term.sum())
        coming = np.append(coming[1:], 0.0) + jump * np.array(facts["excess"])
        term = term + jump * np.array(facts["weights"])
    np.testing.assert_allclose(values, pushed("basset", 3, 1e-6, rates, jumps.astype(float)), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize(
    ("words", "sentence"),
    {
        "format": (("sum", "--near", 1, "--far", 9, "--rtol", 0.1, "--format", "cpp"), "--format must be one of 'table', 'csv', 'json', 'c', 'fortran',"),
        "format of weights": (("weights", "brush", "--steps", 3, "--format", "fortan"), "did you mean 'fortran'?"),
        "range": (("sum", "--near", 9, "--far", 1, "--rtol", 0.1), "far must be greater than near = 9 (seconds), got 1"),
        "steps": (("sum", "--near", 1, "--far", 1.5, "--rtol", 0.1), "far must be greater than 2.5 seconds for steps of near/2, got 1.5"),
        "order": (("sum", "--near", 1, "--far", 9, "--rtol", 0.1, "--order", 11), "order must be a whole number from 1 to 10, got 11"),
        "kernel": (("sum", "--near", 1, "--far", 9, "--rtol", 0.1, "--kernel", "bubbel"), "did you mean 'bubble'?"),
        "needs": (("sum", "--near", 1, "--far", 9, "--rtol", 0.1, "--kernel", "slip_sphere", "--diameter", 1), "--slip-length (m) and --diameter (m) must be"),
        "bubble": (("sum", "--near", 1, "--far", 9, "--rtol", 0.1, "--kernel", "bubble", "--slip", 1), "--slip has no meaning for --kernel bubble"),
        "accuracy": (("sum", "--near", 1, "--far", 9, "--rtol", 1e-20), "rtol must be at least"),
    }.values(),
)  # fmt: skip
def test_mistakes_are_one_sentence(words, sentence):
    result = CliRunner().invoke(cli.main, [str(word) for word in words])
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.split())


def test_a_sum_goes_to_a_file(tmp_path):
    output = tmp_path / "sum.h"
    assert printed("sum", "--near", 1, "--far", 9, "--rtol", 0.1, "--format", "c", "--output", output) == f"written: {output}\n"
    assert output.read_text() == printed("sum", "--near", 1, "--far", 9, "--rtol", 0.1, "--format", "c")
