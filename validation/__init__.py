"""Programs that measure how well the package works; their tables are in ``docs/validation``.

``python -m validation`` lists them. With ``--write-docs`` a program writes its tables into their page; see
``validation.pages``.
"""
