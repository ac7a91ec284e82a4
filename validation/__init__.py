"""Programs that measure how well the package works; their tables are in ``docs/validation``.

``python -m validation`` lists them. ``--write-docs`` writes a program's tables into their page; see ``validation.pages``.
"""
