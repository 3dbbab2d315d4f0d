"""Hundreds to hundreds of thousands of session folders: each is computed once, here or on a cluster, and kept in one table.

    folders.py     which folders are sessions, found as they are asked for
    keys.py        the hash of everything that a result follows from
    compute.py     one session: check, fit and explain, with everything shared, into a row
    table.py       OUT/fleet.sqlite, written by one process alone
    processes.py, cluster.py   who computes: processes of this machine, or a Dask cluster
    run.py         hands out what is not known yet, and keeps what comes back
    results.py     rows as the records that a lot is made of; lot.py the lot of them
    summary.py     what the page says of the table

May import: session, attitude, effects, models, closure, problem, methods, explanation, fitting, lot.
"""
