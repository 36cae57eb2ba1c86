"""Jobs -> clips made by the workers of a Dask cluster, byte for byte those that this machine would make.

`hired` opens a cluster, `farm` hands jobs out, `home` is what stays on the user's machine; `hands` and `errands` are
what runs on a worker.
"""
