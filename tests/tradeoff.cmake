fieldtrace_test(tradeoff_test LABELS quick)
