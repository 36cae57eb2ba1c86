"""A scene's clip -> golden files that hold how it moves and looks; later, the clip again -> what differs from them.

`asking` says what is compared and how closely, `taking` makes the clip, `files` are what lies beside a test; `moved`
and `drawn` compare, `causes` tells what has changed since, `judging` puts them together, `told` and `page` say it all.
Nothing heavy is imported here.
"""
