"""What measures svv, which does not import it: ``svv bench``, a distribution of its own (``pip install ./bench``)."""
