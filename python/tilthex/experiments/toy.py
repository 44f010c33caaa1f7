"""A toy experiment: judged by its own module, found by its name."""

from tilthex.experiments.judge import Judge
from tilthex.experiments.record import below
from tilthex.experiments.report import overview

JUDGE = Judge(
    lambda run, record: [below("toy", float(abs(record.position_error).max()), 0.1, "mm", scale=1e3)],
    lambda flights: {run.name: overview(record) for run, record in flights},
)
