# cmake -DSOURCE=<source folder> -DHEADER=<file> -P commit.cmake
#
# Writes a header with the git commit of the sources, `kCommit`; the file stays as it is, and nothing is compiled again,
# when the commit has not changed. A build outside of a repository has "unknown".
cmake_minimum_required(VERSION 3.25)
set(commit "unknown")
find_program(git git)
if(git AND EXISTS ${SOURCE}/.git)
  execute_process(
    COMMAND ${git} -C ${SOURCE} describe --always --abbrev=10 --exclude=* --dirty=+
    OUTPUT_VARIABLE described
    RESULT_VARIABLE failed
    OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  if(NOT failed)
    set(commit "${described}")
  endif()
endif()
file(CONFIGURE OUTPUT ${HEADER} CONTENT "#pragma once

#include <string_view>

inline constexpr std::string_view kCommit = \"@commit@\";
" @ONLY)
