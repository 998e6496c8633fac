"""Where a model of the pixel fails to explain a run, which effect is missing, and whether adding it helps.

:class:`bench.diagnosis.diagnosis.Diagnosis` goes step by step; `views` hold what is looked at in a run.
"""
