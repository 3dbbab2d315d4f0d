"""The methods: least squares, PSO, TinyGC-Net and its denoiser, each fitted to the same problem.

May import: session, attitude, effects, models, lot, closure, problem.
"""
