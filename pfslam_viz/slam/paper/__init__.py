"""The report's filter: N poses that share one map (Algorithm 1)."""
