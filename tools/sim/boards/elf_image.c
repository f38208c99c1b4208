#include "elf_image.h"

#include <elf.h>
#include <stdio.h>
#include <string.h>

#define MOST_SEGMENTS 16U
#define MOST_LETTERS 64U

static bool fail(const char *path, const char *what, char *error, size_t error_bytes) {
  (void)snprintf(error, error_bytes, "%s: %s", path, what);
  return false;
}

static bool load(FILE *file, const char *path, uint32_t start, uint8_t *flash, size_t flash_bytes, char *error,
                 size_t error_bytes) {
  Elf32_Ehdr header;
  Elf32_Phdr segments[MOST_SEGMENTS];
  bool vectors = false;
  if ((fread(&header, sizeof(header), 1U, file) != 1U) || (memcmp(header.e_ident, ELFMAG, SELFMAG) != 0) ||
      (header.e_ident[EI_CLASS] != ELFCLASS32) || (header.e_machine != EM_ARM) ||
      (header.e_phentsize != sizeof(segments[0])) || (header.e_phnum > MOST_SEGMENTS)) {
    return fail(path, "not an ELF image for ARM", error, error_bytes);
  }
  if ((fseek(file, (long)header.e_phoff, SEEK_SET) != 0) ||
      (fread(segments, sizeof(segments[0]), header.e_phnum, file) != header.e_phnum)) {
    return fail(path, "cut short", error, error_bytes);
  }
  for (uint32_t i = 0U; i < header.e_phnum; i++) {
    const Elf32_Phdr *segment = &segments[i];
    const size_t offset = segment->p_paddr - start;
    if ((segment->p_type != PT_LOAD) || (segment->p_filesz == 0U)) {
      continue;
    }
    if ((segment->p_paddr < start) || (offset > flash_bytes) || (segment->p_filesz > flash_bytes - offset)) {
      return fail(path, "a segment lies outside of the flash", error, error_bytes);
    }
    if ((fseek(file, (long)segment->p_offset, SEEK_SET) != 0) ||
        (fread(flash + offset, 1U, segment->p_filesz, file) != segment->p_filesz)) {
      return fail(path, "cut short", error, error_bytes);
    }
    vectors = vectors || (offset == 0U);
  }
  return vectors || fail(path, "no vectors at the start of the flash", error, error_bytes);
}

bool elf_image_load(const char *path, uint32_t start, uint8_t *flash, size_t flash_bytes, char *error,
                    size_t error_bytes) {
  FILE *file = fopen(path, "rb");
  if (file == NULL) {
    return fail(path, "cannot be opened", error, error_bytes);
  }
  const bool loaded = load(file, path, start, flash, flash_bytes, error, error_bytes);
  (void)fclose(file);
  return loaded;
}

static bool read_at(FILE *file, uint32_t offset, void *out, size_t bytes) {
  return (fseek(file, (long)offset, SEEK_SET) == 0) && (fread(out, bytes, 1U, file) == 1U);
}

static bool has_name(FILE *file, uint32_t offset, const char *name) {
  char found[MOST_LETTERS];
  const size_t bytes = strlen(name) + 1U;
  return (bytes <= sizeof(found)) && read_at(file, offset, found, bytes) && (memcmp(found, name, bytes) == 0);
}

static uint32_t find_object(FILE *file, const char *name, uint32_t bytes) {
  Elf32_Ehdr header;
  Elf32_Shdr table;
  Elf32_Shdr names;
  Elf32_Sym symbol;
  if (!read_at(file, 0U, &header, sizeof(header))) {
    return 0U;
  }
  for (uint32_t i = 0U; i < header.e_shnum; i++) {
    const uint32_t sections = header.e_shoff;
    const bool whole = read_at(file, sections + (i * (uint32_t)sizeof(table)), &table, sizeof(table)) &&
                       (table.sh_type == SHT_SYMTAB) &&
                       read_at(file, sections + (table.sh_link * (uint32_t)sizeof(names)), &names, sizeof(names));
    for (uint32_t at = 0U; whole && (at < table.sh_size); at += (uint32_t)sizeof(symbol)) {
      if (read_at(file, table.sh_offset + at, &symbol, sizeof(symbol)) && (symbol.st_size == bytes) &&
          (ELF32_ST_TYPE(symbol.st_info) == STT_OBJECT) && has_name(file, names.sh_offset + symbol.st_name, name)) {
        return symbol.st_value;
      }
    }
  }
  return 0U;
}

uint32_t elf_image_object(const char *path, const char *name, uint32_t bytes) {
  FILE *file = fopen(path, "rb");
  uint32_t address = 0U;
  if (file != NULL) {
    address = find_object(file, name, bytes);
    (void)fclose(file);
  }
  return address;
}
