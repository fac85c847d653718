# plenocal_embed(<target> <function> <file>): the file's content becomes part of the program, as
# std::string_view plenocal::<function>().
function(plenocal_embed target function file)
  set(source ${CMAKE_CURRENT_BINARY_DIR}/${function}.cc)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/embedded.cc.in ${source} @ONLY)
  set_source_files_properties(${source} PROPERTIES OBJECT_DEPENDS ${file} SKIP_UNITY_BUILD_INCLUSION ON)
  target_sources(${target} PRIVATE ${source})
  if(TARGET plenocal_web)
    add_dependencies(${target} plenocal_web)
  endif()
endfunction()
