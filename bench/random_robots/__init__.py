"""Robots drawn at random, with a hidden effect or none: plants, motions and recordings that judge the diagnosis.

Written apart from the product: plain MuJoCo, NumPy and rosbags. Nothing here imports `twin_daemon.effects` or
`twin_daemon.diagnosis`, so that a law which both get wrong would have to be got wrong twice.
"""
