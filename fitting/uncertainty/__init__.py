"""Standard errors of correlated residuals, bootstrap over runs, profile likelihood."""
