"""Functions as graphs that other libraries load: CasADi functions, and the residual network as ONNX."""
