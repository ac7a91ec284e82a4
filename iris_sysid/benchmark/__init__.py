"""Many clips at once: measure a data set, study each clip, compare methods in tables.

``dataset`` lists the clips of a folder. ``groundtruth`` measures them and writes ``parameters.json``. ``sources`` reads
what others produced (latent pipelines, classifiers, published tables). ``studies`` make rows from measured clips,
``tables`` make tables from rows, and ``build`` does all of it into one folder.
"""
