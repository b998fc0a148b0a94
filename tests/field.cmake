fieldtrace_test(chart_test LABELS quick numerics)
