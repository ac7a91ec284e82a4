"""The whole way from a clip to a fit, for one clip and for many.

``one_clip`` tracks, measures and fits one. ``parallel`` runs independent jobs in processes or, by ``cluster``, on other
machines; ``batch`` is what they are given. ``clip_folders`` finds the tables of a folder, ``diagnose_each`` diagnoses
them.
"""
