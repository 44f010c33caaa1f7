"""The paper's experiments, with the world simulated by MuJoCo.

Needs the extra `experiments`: `pip install 'tilthex[experiments]'`. An experiment is a TOML
file beside this module, a scene (`scenes`), and a module that judges and draws it.
"""
