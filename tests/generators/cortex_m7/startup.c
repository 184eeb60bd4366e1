/* Vector table of an emulated Cortex-M7: stack and reset. The C library does the rest. */
extern void _mainCRTStartup(void);
extern unsigned char stack_top[];
__attribute__((section(".vectors"), used)) static const void *const vectors[2] = {
    stack_top, (const void *)_mainCRTStartup};
