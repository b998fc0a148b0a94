// Modules: parts of the program in shared libraries of their own, opened when first needed, because what they are made
// of brings so many other libraries that every start would pay for them.
//
// A module NAME is libfieldtrace_NAME.so, built by fieldtrace_module() (cmake/Components.cmake); it lies in
// ../lib/fieldtrace beside the folder of the program; or, for libfieldtrace.so in other programs, in the folder
// fieldtrace beside that library; or, for programs that hold the static library, where it was to be installed or on the
// program's run path. It is reached by plain functions, is never closed, and lets no exceptions out but those of the
// standard library and of libraries that derive from them: sanitizers take types that module and program both define,
// Error for one, for two types. Module and program must be of one build.
// Thread-safety: pure functions.
#pragma once

#include <string>

namespace fieldtrace {

// Address of `function` in module `name`, which is opened if it is not open yet. Takes microseconds if it is: keep the
// address. Throws Error naming the module's file and the system's reason if it cannot be opened or lacks the function.
void* module_function(const std::string& name, const char* function);

// Throws the same if the module is missing. Takes microseconds: where its file lies as expected, it is not opened.
void require_module(const std::string& name);

}  // namespace fieldtrace
