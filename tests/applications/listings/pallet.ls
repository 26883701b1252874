/PROG  PALLET
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "";
PROG_SIZE	= 1204;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
/MN
   1:  PALLETIZING-B_3 ;
   2:J PAL_3[A_1] 100% FINE    ;
   3:L PAL_3[BTM] 100mm/sec FINE    ;
   4:J PAL_3[R_1] 100% FINE    ;
   5:  PALLETIZING-END_3 ;
   6:J P[1] 20% FINE    ;
   7:S P[2] 100mm/sec CNT100    ;
/POS
P[1]{
   GP1:
	UF : 2, UT : 3,	
	J1=    27.252 deg,	J2=    35.150 deg,	J3=    -7.038 deg,
	J4=    -1.946 deg,	J5=    58.403 deg,	J6=    10.724 deg
};
P[2]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   258.739  mm,	Y =  1872.358  mm,	Z =  2142.529  mm,
	W =   -40.279 deg,	P =   -50.319 deg,	R =   121.524 deg
};
/END
