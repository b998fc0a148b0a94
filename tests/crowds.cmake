fieldtrace_test(instance_tree_test LABELS quick)
fieldtrace_test(crowd_test LABELS quick)
