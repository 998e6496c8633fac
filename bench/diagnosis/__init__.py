"""Where a model of the pixel fails to explain a run, which effect is missing, and whether adding it helps.

In the making: views, expectations and the screen of effects are there and tested; the fit converges slowly on small
runs, and no command leads here yet.
"""
