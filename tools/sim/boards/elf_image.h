/// Loads a linked image into flash.
#ifndef CRUX_EMULATED_ELF_IMAGE_H
#define CRUX_EMULATED_ELF_IMAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/// Copies the ELF file's segments to `flash` by their load addresses, of which `start` is the first. On failure false,
/// with the reason in `error`.
bool elf_image_load(const char *path, uint32_t start, uint8_t *flash, size_t flash_bytes, char *error,
                    size_t error_bytes);

/// Address of the object of this name and size, 0: the image has none.
uint32_t elf_image_object(const char *path, const char *name, uint32_t bytes);

#endif
