"""Clips on disk -> a data set that training reads: a folder with `metadata.jsonl`, or WebDataset shards.

`found` walks the folders, `sample` reads a clip, `splits` says where it belongs, `folders` and `shards` write, `card`
tells people, `gathering` does it all. Memory does not grow with the clips, and what is there already stays.
"""
