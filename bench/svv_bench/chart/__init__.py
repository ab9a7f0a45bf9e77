"""Speed and size against accuracy: many runs on given scenes, their table and their charts.

``plan`` lists and names the runs, ``scenes`` provides the views, ``trial`` is the work of one process, ``process``
starts it and follows its progress, ``table`` and ``figures`` show the results, and ``job`` combines them all.
"""

from svv_bench.charts import need_matplotlib

need_matplotlib()  # before hours of runs, and before a module that imports it
