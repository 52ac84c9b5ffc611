"""What is compiled meanwhile, counted in events of the compiler: seconds would depend on the machine."""

import numba


class Compilations(numba.core.event.Listener):
    """Names of the functions that are compiled, nested ones too."""

    def __init__(self):
        self.names = []

    def on_start(self, event):
        self.names.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event):
        pass
