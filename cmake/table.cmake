# plenocal_camel_case(<variable> <stem>): x_y becomes XY.
function(plenocal_camel_case variable stem)
  string(REPLACE "_" ";" words ${stem})
  set(name "")
  foreach(word IN LISTS words)
    string(SUBSTRING ${word} 0 1 initial)
    string(SUBSTRING ${word} 1 -1 rest)
    string(TOUPPER ${initial} initial)
    string(APPEND name ${initial}${rest})
  endforeach()
  set(${variable}
      ${name}
      PARENT_SCOPE)
endfunction()

# plenocal_table(<variable> FOLDER <folder> [ALSO <folder>...] NAME <function> TYPE <type> SUFFIX <suffix>
#                HEADER <header>)
#
# The table of a folder, and of others beside it, whose file x_y.cc defines `<type> XY<suffix>()`: puts the folder's files and a generated source,
# which defines `std::span<const <type>> <function>()` of <header>, into <variable>. So a new file is in the table without
# another edit. The order is that of the file names; nothing runs before main().
function(plenocal_table variable)
  cmake_parse_arguments(arg "" "FOLDER;NAME;TYPE;SUFFIX;HEADER" "ALSO" ${ARGN})
  set(patterns ${arg_FOLDER})
  list(APPEND patterns ${arg_ALSO})
  list(TRANSFORM patterns APPEND /*.cc)
  file(
    GLOB sources
    RELATIVE ${CMAKE_CURRENT_SOURCE_DIR}
    CONFIGURE_DEPENDS ${patterns})
  list(SORT sources COMPARE FILE_BASENAME)
  set(declarations "")
  set(entries "")
  foreach(source IN LISTS sources)
    get_filename_component(stem ${source} NAME_WE)
    plenocal_camel_case(entry ${stem})
    string(APPEND declarations "${arg_TYPE} ${entry}${arg_SUFFIX}();\n")
    string(APPEND entries "${entry}${arg_SUFFIX}(), ")
  endforeach()
  set(table ${CMAKE_CURRENT_BINARY_DIR}/${arg_FOLDER}_table.cc)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/table.cc.in ${table} @ONLY)
  set(${variable}
      ${sources} ${table}
      PARENT_SCOPE)
endfunction()
