# The project's Python: the virtual environment made by tools/setup/setup. Sets CRUX_PYTHON and CRUX_PLATLIB.
set(CRUX_VENV ${CMAKE_SOURCE_DIR}/.venv CACHE PATH "Python virtual environment")
set(CRUX_PYTHON ${CRUX_VENV}/bin/python)
if(NOT EXISTS ${CRUX_PYTHON})
  message(FATAL_ERROR "No virtual environment at ${CRUX_VENV}: run `make setup` first.")
endif()
# Packages of other versions lie elsewhere.
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${CRUX_VENV}/crux-lock.sha256)
if(NOT CRUX_PLATLIB) # told where it is another architecture's
  execute_process(
    COMMAND ${CRUX_PYTHON} -c "import sysconfig; print(sysconfig.get_path('platlib'))"
    OUTPUT_VARIABLE CRUX_PLATLIB OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
endif()
