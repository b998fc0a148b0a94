fieldtrace_test(compare_test LABELS quick)
