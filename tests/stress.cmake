fieldtrace_test(stress_test LABELS slow)
