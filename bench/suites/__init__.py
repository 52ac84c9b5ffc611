"""One question per file. A file here is a suite: its first line asks, `run(full)` answers with a dict for JSON.

Unless in full it takes seconds, a minute at most with what it has to compile. `make report` shows the committed data of those that cannot:
"""

TOO_LONG = {
    "advice": "thousands of timed candidates",
    "blind": "three hundred runs",
    "chapter4": "a hundred and more clouds",
    "choosing": "32 sets of effects to compile",
    "choosing_scheme": "thousands of flights",
    "eddies": "a hundred thousand tracers, and four forms of flight to compile",
    "flights": "a dozen forms of flight to compile",
    "grains": "clouds of ten thousand grains",
    "measured": "ten thousand short flights",
    "particles": "compiled flows, and another package",
    "peers": "other packages",
    "saltation": "some thirty forms of flight to compile",
    "scenes": "hundreds of flights, and a dozen forms of them to compile",
    "stepper": "everything is compiled four times",
    "turbulence": "hundreds of flights among eddies, many repeated until stream and grains agree",
}
