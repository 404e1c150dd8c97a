# What an installation holds: the program, the libraries with their headers, and a CMake package that knows both.
#   find_package(lmc)                        lmc::lmc (the program) and the function lmc_bake()
#   find_package(lmc COMPONENTS libraries)   also lmc::scene, lmc::radiosity, lmc::ao and lmc::tangent; needs the libraries that these were built with
include(CMakePackageConfigHelpers)
set(LMC_INSTALL_CMAKEDIR ${CMAKE_INSTALL_LIBDIR}/cmake/lmc)
set(LMC_INSTALL_DATADIR ${CMAKE_INSTALL_DATADIR}/lmc)

if(TARGET lmc)
  install(TARGETS lmc EXPORT lmcProgram RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  install(EXPORT lmcProgram NAMESPACE lmc:: DESTINATION ${LMC_INSTALL_CMAKEDIR})
endif()

set(lmc_installed_libraries "")
foreach(library scene radiosity ao tangent)
  if(TARGET ${library})
    install(TARGETS ${library} EXPORT lmcLibraries ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
    install(DIRECTORY ${PROJECT_SOURCE_DIR}/lib${library} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/lmc FILES_MATCHING PATTERN "*.h")
    list(APPEND lmc_installed_libraries lmc::${library})
  endif()
endforeach()
if(lmc_installed_libraries)
  install(EXPORT lmcLibraries NAMESPACE lmc:: DESTINATION ${LMC_INSTALL_CMAKEDIR})
endif()

configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/lmcConfig.cmake.in ${PROJECT_BINARY_DIR}/lmcConfig.cmake
  INSTALL_DESTINATION ${LMC_INSTALL_CMAKEDIR} PATH_VARS LMC_INSTALL_DATADIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/lmcConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/lmcConfig.cmake ${PROJECT_BINARY_DIR}/lmcConfigVersion.cmake DESTINATION ${LMC_INSTALL_CMAKEDIR})

install(FILES ${PROJECT_SOURCE_DIR}/cmake/lmc_bake.cmake DESTINATION ${LMC_INSTALL_DATADIR}/cmake)
install(FILES ${PROJECT_SOURCE_DIR}/README.md ${PROJECT_SOURCE_DIR}/CHANGELOG.md ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY ${PROJECT_SOURCE_DIR}/docs/ DESTINATION ${CMAKE_INSTALL_DOCDIR}/docs)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/shaders DESTINATION ${LMC_INSTALL_DATADIR}
  FILES_MATCHING PATTERN "*.vert" PATTERN "*.frag" PATTERN "*.glsl" PATTERN "LICENSE")
