"""Speed and size against accuracy: many runs on given scenes, their table and their charts.

``plan`` says which runs there are and how they are told apart, ``scenes`` where the views come from, ``trial`` is what
one process does, ``process`` starts it and listens, ``table`` and ``figures`` show what came out, ``job`` is the whole.
"""

from svv.bench.charts import need_matplotlib

need_matplotlib()  # before hours of runs, and before a module that imports it
