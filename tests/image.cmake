fieldtrace_test(image_test LABELS quick)
