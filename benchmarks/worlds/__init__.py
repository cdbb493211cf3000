"""Do intervals hold in random whole worlds, each flown by an engine of its own?

    python -m benchmarks.worlds --worlds 1000 --seed 1 --workers 2 -o worlds.jsonl
    python -m benchmarks.worlds --show worlds.jsonl [--against before.jsonl]
    python -m benchmarks.worlds --seed 1 --only 417 [--keep FOLDER]    # one world again
    python -m benchmarks.worlds --seed 1 --only 417 --blame    # and without each of its hazards
    python -m benchmarks.worlds --seed 1 --alone -o alone.jsonl    # one hazard a world, in turn
    python -m benchmarks.worlds --seed 1 --alone --told -o told.jsonl    # and told of it
    python -m benchmarks.worlds --seed 2 --hazards gusts drag=1 ...    # these alone, and how likely

A world is a vehicle, its motors, autopilot, sensors, air, flight and log, all drawn at random; on
top of them come hazards (`hazards.py`), each with a chance of its own. It is flown by a rigid body
written here (`engine.py`) that shares nothing with the model of the library: many worlds advance
together as arrays, 1 ms a step, and the autopilot hears what the sensors say, not what is true. The
flight becomes a table and an experiment file as a user writes them, and is identified. A world
becomes one line of JSON; a broken-off study goes on where it was.
"""
