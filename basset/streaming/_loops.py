"""The compiled inner loops of a stream: one sample of one component at a time.

Layout, chosen so that a component's whole state lies in a few cache lines and sums run over contiguous memory:
samples (components, S): a ring of B = L+1 slots written twice, B apart, so that the last B samples are always one
contiguous stretch (S = 2B); a stream of the whole history never wraps (S = B). terms (components, T): the exponentials'
states. future (components, R): a ring of contributions of earlier segments, slot node % R; the newest
node's slot is kept until the next sample comes.

Decay is applied as a loss 1 − exp(−λ dt): a rate that changes little in a step then keeps all its digits over 1e6 steps.
"""

from __future__ import annotations

import math

import numpy as np

from basset._compile import compiled
from basset.spectrum import ratio_at

TILE = 8  # components advanced together: one cache line of a block of samples


@compiled(reassociate=True)
def dot(weights, first_weight, samples, first_sample, count):
    # unsigned: a signed index may be negative, and the check for it keeps the loop from vectorising
    start, other = np.uintp(first_weight), np.uintp(first_sample)
    total = 0.0
    for i in range(np.uintp(count)):
        total += weights[start + i] * samples[other + i]
    return total


@compiled(reassociate=True)
def advance(terms, loss, gain, sample):
    total = 0.0
    for i in range(len(terms)):
        term = terms[i] + (gain[i] * sample - loss[i] * terms[i])
        terms[i] = term
        total += term
    return total


@compiled()
def row(n, samples, short, oldest, interior):
    """Start-up: the whole-history row n over samples[0 … n]."""
    if n < len(short):
        return dot(short[n], 0, samples, 0, n + 1)
    reach = oldest.shape[1]
    count = n + 1 - reach
    return dot(oldest[n - len(short)], 0, samples, 0, reach) + dot(interior, len(interior) - count, samples, reach, count)


@compiled()
def run(samples, terms, future, count, node, pending, rates, history, slots, short, oldest, interior, steady, fixed, loss, gain, entry):
    """Advance every component by all rows of `rates` (steps, components); H into `history`, same shape."""
    steps, components = rates.shape
    mirrored = samples.shape[1] > slots
    ring = future.shape[1]
    for first in range(0, components, TILE):
        last = min(first + TILE, components)
        for step in range(steps):
            n = count + step
            position = n % slots
            for c in range(first, last):
                rate = rates[step, c]
                samples[c, position] = rate
                if mirrored:
                    samples[c, position + slots] = rate
                if n > steady:
                    oldest_sample = samples[c, position + 1]
                    value = dot(fixed, 0, samples[c], position + 1, slots) + advance(terms[c], loss, gain, oldest_sample)
                elif n < steady:
                    value = row(n, samples[c], short, oldest, interior) + advance(terms[c], loss, gain, 0.0)
                else:
                    value = dot(fixed, slots - 1 - n, samples[c], 0, n + 1)
                    for i in range(len(terms[c])):
                        terms[c, i] += dot(entry[i], 0, samples[c], 0, entry.shape[1]) - loss[i] * terms[c, i]
                        value += terms[c, i]
                if step <= pending:
                    future[c, (node + step - 1) % ring] = 0.0
                    value += future[c, (node + step) % ring]
                history[step, c] = value


@compiled()
def peek(samples, terms, future, n, node, pending, slots, short, oldest, interior, steady, fixed, loss, gain, entry, result):
    """H at the node after the newest for a next sample of zero, into `result` (components,); nothing is changed."""
    for c in range(len(samples)):
        value = 0.0
        if pending > 0:
            value = future[c, node % future.shape[1]]
        for i in range(terms.shape[1]):
            value += terms[c, i] - loss[i] * terms[c, i]
        if n > steady:
            begin = n % slots + 1  # of the newest slots − 1 samples
            value += dot(fixed, 0, samples[c], begin, slots - 1)
            for i in range(terms.shape[1]):
                value += gain[i] * samples[c, begin]
        elif n < steady:
            if n < len(short):
                value += dot(short[n], 0, samples[c], 0, n)
            else:
                reach = oldest.shape[1]
                count = n + 1 - reach
                value += dot(oldest[n - len(short)], 0, samples[c], 0, reach)
                value += dot(interior, len(interior) - count, samples[c], reach, count - 1)
        else:
            value += dot(fixed, slots - 1 - n, samples[c], 0, n)
            for i in range(terms.shape[1]):
                value += dot(entry[i], 0, samples[c], 0, entry.shape[1])
        result[c] = value


@compiled()
def take(samples, terms, future, n, node, rates, tail, local, history, slots, steady, loss, gain, entry):
    """Accept one sample of every component after `peek` gave `tail`: H = tail + local·sample, without a sum over samples again."""
    position = n % slots
    for c in range(len(samples)):
        samples[c, position] = rates[c]
        if samples.shape[1] > slots:
            samples[c, position + slots] = rates[c]
        if n == steady:
            for i in range(terms.shape[1]):
                terms[c, i] += dot(entry[i], 0, samples[c], 0, entry.shape[1]) - loss[i] * terms[c, i]
        else:
            advance(terms[c], loss, gain, samples[c, position + 1] if n > steady else 0.0)
        future[c, (node - 1) % future.shape[1]] = 0.0
        history[c] = tail[c] + local * rates[c]


@compiled()
def follow(terms, loss, gain, samples, history):
    """Add the exponentials' part at every node to `history`; samples (nodes, components): those that enter there."""
    for c in range(len(terms)):
        for step in range(len(samples)):
            history[step, c] += advance(terms[c], loss, gain, samples[step, c])


@compiled()
def follow_slip(m, samples, impulses, terms, count, rates, log_stretches, history, room):
    """Advance every component (rows of `terms`) by all rows of `rates`, `log_stretches` being ln C^(2/3) there."""
    steps, components = rates.shape
    weights, newest = room
    last = samples.shape[1] - 1
    window = (last + 1) // 2
    slowest = m.tail.values.shape[0] - 1
    for step in range(steps):
        n, log_stretch = count + step, math.nan
        row = (min(n, last) - 1) * last
        entering = m.entering[1 if n > last else 0]
        for c in range(components):
            for j in range(last, 0, -1):
                samples[c, j] = samples[c, j - 1]
                impulses[c, j] = impulses[c, j - 1]
            samples[c, 0] = rates[step, c]
            impulses[c, 0] = 0.0
            history[step, c] = 0.0
            if n == 0:
                continue
            if log_stretches[step, c] != log_stretch:  # often one slip for all directions of space
                log_stretch = log_stretches[step, c]
                for q in range(terms.shape[1]):
                    ratio = ratio_at(m.tail.low, m.tail.inverse_step, m.tail.values, min(q, slowest), m.tail.log_rates[q] - log_stretch)
                    weights[q] = m.tail.weights[q] * ratio
                for j in range(last):
                    newest[j] = m.local.weights[row + j] * ratio_at(m.local.low, m.local.inverse_step, m.local.values, row + j, -log_stretch)
            value = 0.0
            for j in range(last):
                value += newest[j] * samples[c, j]
            for q in range(terms.shape[1]):
                gain = impulses[c, window] * m.reached[q]
                if n >= last:
                    for j in range(last):
                        gain += entering[q, j] * samples[c, j + 1]
                terms[c, q] += gain - m.loss[q] * terms[c, q]
                value += weights[q] * terms[c, q]
            for j in range(1, window):
                if impulses[c, j] != 0.0:
                    value += impulses[c, j] / math.sqrt(j) * (1.0 + math.exp(1.5 / m.c1 * (log_stretch + math.log(j)))) ** -m.c1
            history[step, c] = m.root * value
