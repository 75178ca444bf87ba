/* From reset to main on a Cortex-M7, with a debugger (here QEMU) as its console. */

#include <stdlib.h>
#include <string.h>

#define CPACR (*(volatile unsigned *)0xE000ED88) /* access to coprocessors */

extern char stack_top[], bss_start[], bss_end[];
extern void initialise_monitor_handles(void);
extern int main(void);

static void reset(void)
{
  CPACR |= 0xFu << 20; /* the floating point unit */
  __asm__ volatile("dsb\nisb");
  memset(bss_start, 0, (size_t)(bss_end - bss_start));
  initialise_monitor_handles();
  exit(main());
}

static void fault(void) { abort(); }

struct vectors {
  char *stack;
  void (*handlers[6])(void);
};

__attribute__((section(".vectors"), used)) static const struct vectors vectors = {
    stack_top, {reset, fault, fault, fault, fault, fault}};
