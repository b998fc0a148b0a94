fieldtrace_test(chart_test LABELS quick numerics)
fieldtrace_test(field_query_test LABELS quick)
