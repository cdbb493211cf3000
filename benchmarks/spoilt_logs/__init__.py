"""What does `identify` say of real logs that were spoilt by one realistic fault each?

    python -m benchmarks.spoilt_logs [--only NAME] [--workers N] [--keep FOLDER] [-o table.md]
    python -m benchmarks.spoilt_logs --page docs/spoilt-logs.md     # the table of that page
    python -m benchmarks.spoilt_logs --windows 600     # random windows of every log, seconds of it

Each case takes one sound real log ($ROTORFIT_DATA, ../shared/data), changes a channel of it or the
declared experiment by one fault, writes it as a flight table and runs the command line on it, so
that what is recorded is what a user sees. The unspoilt log goes the same way first, and must come
out as its own file does. A number that is given is held against what is known of the vehicle, else
against that of the unspoilt log, and the case is

- refused: no numbers;
- said: numbers lie outside their intervals, and a sentence names the cause;
- hangs on: they do, nothing in any flight can tell, and the result names what they hang on;
- vague: they do, and what is said besides is of something else;
- SILENT: they do, and nothing is said that is not said of the unspoilt log;
- harmless: every number still holds.
"""
