"""One file per verb of ``mmg``: read arguments, call one function below, print or write."""
