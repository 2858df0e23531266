"""Which trial to run next: candidate manoeuvres and what each would determine."""
