"""The ship as C: one header, one source, an example; no CasADi, no allocation, no globals."""
