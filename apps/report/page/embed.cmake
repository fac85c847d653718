# cmake -P embed.cmake OUTPUT NAME=FILE...: a .cc file with the content of text files as constants
# plenocal::NAME.
math(EXPR last "${CMAKE_ARGC} - 1")
set(output ${CMAKE_ARGV3})
set(text "#include \"apps/report/page_parts.h\"\n\nnamespace plenocal {\n\n")
foreach(i RANGE 4 ${last})
  string(REGEX MATCH "^([^=]+)=(.+)$" ignored "${CMAKE_ARGV${i}}")
  set(name ${CMAKE_MATCH_1})
  file(READ "${CMAKE_MATCH_2}" content)
  string(APPEND text "const std::string_view ${name} = R\"EMBED(${content})EMBED\";\n\n")
endforeach()
string(APPEND text "}  // namespace plenocal\n")
file(WRITE ${output} "${text}")
