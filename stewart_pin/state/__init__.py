"""When loops are closed: rows, gap, Jacobian, bias, and the Newton iteration that closes them."""
