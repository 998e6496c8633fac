"""Where a model of the pixel fails to explain a run, which effect is missing, and whether adding it helps.

:class:`bench.diagnosis.diagnosis.Diagnosis` goes step by step. Below it are floors, each of which knows only those
below: `searching` for what is missing, `fitting` numbers, what is `expected` by a model, what is `recorded` in a run,
with `views` of it. Above it, `telling` puts all of it into words and files.
"""
