# What Debian asks of each package, put into it before it is closed: copyright, changelog, compressed man pages, static
# libraries without local symbols.
set(names_program plenocal)
set(names_dev libplenocal-dev)
set(names_python python3-plenocal)
set(year 2026)
foreach(component IN LISTS CPACK_COMPONENTS_ALL)
  set(name ${names_${component}})
  set(root ${CPACK_TEMPORARY_DIRECTORY}/${component}/usr)
  set(doc ${root}/share/doc/${name})
  file(
    WRITE ${doc}/copyright
    "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: Plenocal

Files: *
Copyright: ${year} The Plenocal contributors
License: Apache-2.0
 On Debian systems, the text of the Apache License, Version 2.0, is in
 /usr/share/common-licenses/Apache-2.0.
")
  file(
    WRITE ${doc}/changelog
    "plenocal (${CPACK_PACKAGE_VERSION}) bookworm; urgency=medium

  * CHANGELOG.md of the source.

 -- ${CPACK_PACKAGE_CONTACT}  Thu, 01 Jan ${year} 00:00:00 +0000
")
  execute_process(COMMAND gzip -9n ${doc}/changelog COMMAND_ERROR_IS_FATAL ANY)
  file(GLOB pages ${root}/share/man/man1/*.1)
  if(pages)
    execute_process(COMMAND gzip -9n ${pages} COMMAND_ERROR_IS_FATAL ANY)
  endif()
  file(GLOB_RECURSE archives ${root}/lib/*.a)
  foreach(archive IN LISTS archives)
    execute_process(COMMAND strip --strip-debug --remove-section=.comment --remove-section=.note --enable-deterministic-archives
                            ${archive} COMMAND_ERROR_IS_FATAL ANY)
  endforeach()
  # Directories of the build have its umask.
  execute_process(COMMAND chmod -R u=rwX,go=rX ${root} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
